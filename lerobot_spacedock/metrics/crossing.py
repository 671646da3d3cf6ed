"""The port plane's crossing, and the closest approach, from logged states alone."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.metrics.lengths import lengths
from lerobot_spacedock.physics.contact import Port
from lerobot_spacedock.physics.frames import MASS, POSITION, QUATERNION, RATE, VELOCITY

BISECTIONS = 60


def hermite(
    p0: np.ndarray, v0: np.ndarray, p1: np.ndarray, v1: np.ndarray, dt: float | np.ndarray, s: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity at the share ``s`` of a step; exact for a linearly varying acceleration.

    Args:
        p0, v0, p1, v1: position and velocity at both ends, (..., 3).
        dt: s, length of the step, a number or (..., 1).
        s: in [0, 1], likewise.
    """
    s2, s3 = s * s, s * s * s
    position = (2 * s3 - 3 * s2 + 1) * p0 + (s3 - 2 * s2 + s) * dt * v0 + (3 * s2 - 2 * s3) * p1 + (s3 - s2) * dt * v1
    velocity = (6 * s2 - 6 * s) * (p0 - p1) / dt + (3 * s2 - 4 * s + 1) * v0 + (3 * s2 - 2 * s) * v1
    return position, velocity


def plane_crossing(time: np.ndarray, state: np.ndarray, port: Port) -> tuple[float, np.ndarray] | None:
    """When and in what state the chaser first passed the port plane from outside.

    Args:
        time: s, (K+1,).
        state: SI, (K+1, 14).
        port: whose plane is meant.

    Returns:
        Time and state (14,): position and velocity by cubic Hermite interpolation inside the step, attitude and rate
        linear; ``None`` where the plane was not passed. A state on the plane counts as passed.
    """
    axial = port.axis_sign * state[:, 1]
    inward = np.flatnonzero((axial[:-1] > 0.0) & (axial[1:] <= 0.0))
    if not inward.size:
        return None
    k = int(inward[0])
    dt = float(time[k + 1] - time[k])
    if axial[k + 1] == 0.0 or dt <= 0.0:
        return float(time[k + 1]), state[k + 1].copy()
    a, b = state[k], state[k + 1]
    high = _first_root(axial[k], axial[k + 1], *(port.axis_sign * dt * s[VELOCITY][1] for s in (a, b)))
    crossing = a + high * (b - a)
    crossing[POSITION], crossing[VELOCITY] = hermite(a[POSITION], a[VELOCITY], b[POSITION], b[VELOCITY], dt, high)
    q_b = b[QUATERNION] if np.dot(a[QUATERNION], b[QUATERNION]) >= 0.0 else -b[QUATERNION]
    q = a[QUATERNION] + high * (q_b - a[QUATERNION])
    crossing[QUATERNION] = q / np.linalg.norm(q)
    crossing[RATE], crossing[MASS] = a[RATE] + high * (b[RATE] - a[RATE]), a[MASS] + high * (b[MASS] - a[MASS])
    return float(time[k] + high * dt), crossing


def _first_root(y0: float, y1: float, slope0: float, slope1: float) -> float:
    """Share of a step at which the cubic with these ends and slopes has fallen to zero; ``y0`` > 0 ≥ ``y1``."""
    y0, y1, slope0, slope1 = float(y0), float(y1), float(slope0), float(slope1)  # a NumPy scalar costs ten times more
    cubic, square = 2.0 * (y0 - y1) + slope0 + slope1, 3.0 * (y1 - y0) - 2.0 * slope0 - slope1
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        s = 0.5 * (low + high)
        low, high = (s, high) if ((cubic * s + square) * s + slope0) * s + y0 > 0.0 else (low, s)
    return high


def closest_approach(position: np.ndarray) -> float:
    """Least distance from the port along the path, straight between states. m, (K+1, 3) → m."""
    nearest = float(lengths(position).min())
    if len(position) < 2:
        return nearest
    leg = np.diff(position, axis=0)
    length2 = np.einsum("ij,ij->i", leg, leg)
    along = -np.einsum("ij,ij->i", position[:-1], leg)
    s = np.clip(np.divide(along, length2, out=np.zeros_like(along), where=length2 > 0.0), 0.0, 1.0)
    return min(nearest, float(lengths(position[:-1] + s[:, None] * leg).min()))


def range_rate(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Range in m and its rate in m/s (negative: closing); at the port itself the rate is −speed. (K, 3) → (K,)."""
    distance = lengths(position)
    safe = np.where(distance > 0.0, distance, 1.0)
    rate = np.einsum("ij,ij->i", position, velocity) / safe
    return distance, np.where(distance > 0.0, rate, -lengths(velocity))
