"""The pinhole model: intrinsics, extrinsics, and what is accepted as a pose or a Sun direction.

Image coordinates are continuous, in pixels, with the origin at the outer corner of the top left pixel: pixel (row i,
column j) covers j ≤ u < j+1, i ≤ v < i+1, and its centre is (j+½, i+½).
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.errors import InputError

from .config import CameraConfig


def intrinsics(config: CameraConfig) -> np.ndarray:
    """Camera matrix K, (3, 3): u = K p_C / z with p_C in camera axes (right, down, forward)."""
    f = 0.5 * config.height / math.tan(0.5 * math.radians(config.vfov_deg))
    return np.array([[f, 0.0, 0.5 * config.width], [0.0, f, 0.5 * config.height], [0.0, 0.0, 1.0]])


def rotation_CH(q_HB: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of Hill vectors into camera axes: rows are right (+y_B), down (-x_B) and forward (+z_B).

    Args:
        q_HB: attitude, (4,), scalar first; turns body vectors into Hill vectors.
    """
    w, x, y, z = np.asarray(q_HB, float).tolist()
    bx = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    by = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    bz = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    return np.array([by, (-bx[0], -bx[1], -bx[2]), bz])


def extrinsics(r_H: np.ndarray, q_HB: np.ndarray) -> np.ndarray:
    """(4, 4) transform of Hill points into camera axes: p_C = T (p_H, 1).

    Args:
        r_H: m, (3,), the camera in Hill axes, relative to the port.
        q_HB: attitude, (4,), scalar first.
    """
    out = np.zeros((4, 4))
    out[:3, :3] = rotation_CH(q_HB)
    out[:3, 3] = -out[:3, :3] @ np.asarray(r_H, float)
    out[3, 3] = 1.0
    return out


def project_points(config: CameraConfig, r_H: np.ndarray, q_HB: np.ndarray, points_H: np.ndarray) -> np.ndarray:
    """Hill points (N, 3) m → (N, 3): column u, row v (pixels) and depth along the view axis (m)."""
    transform = extrinsics(r_H, q_HB)
    p = np.asarray(points_H, float) @ transform[:3, :3].T + transform[:3, 3]
    k = intrinsics(config)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([k[0, 0] * p[:, 0] / p[:, 2] + k[0, 2], k[1, 1] * p[:, 1] / p[:, 2] + k[1, 2], p[:, 2]], -1)


def checked_pose(r_H: object, q_HB: object) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) m and unit quaternion (4,) as float64, or an InputError."""
    r = _vector("r_H", r_H, 3, "three finite numbers, metres, each below 1e6")
    q = _vector("q_HB", q_HB, 4, "four finite numbers, scalar first")
    if max(map(abs, r.tolist())) > 1e6:
        raise InputError("r_H", r_H, "three finite numbers, metres, each below 1e6")
    w, x, y, z = q.tolist()
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 < norm < 1.1:
        raise InputError("q_HB", q_HB, "a unit quaternion (norm 0.9 to 1.1; it is normalised)")
    return r, q / norm


def checked_sun(sun_H: object) -> np.ndarray:
    """Unit vector (3,) towards the Sun as float64, or an InputError."""
    sun = _vector("sun_H", sun_H, 3, "three finite numbers, not all zero")
    x, y, z = sun.tolist()
    norm = math.sqrt(x * x + y * y + z * z)
    if norm < 1e-9:
        raise InputError("sun_H", sun_H, "a direction towards the Sun; zero has none")
    return sun / norm


def _vector(what: str, given: object, size: int, allowed: str) -> np.ndarray:
    try:
        out = np.array(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(what, given, allowed) from error
    if out.shape != (size,) or not all(map(math.isfinite, out.tolist())):
        raise InputError(what, given, allowed)
    return out
