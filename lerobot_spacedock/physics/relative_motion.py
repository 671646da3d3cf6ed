"""Hill–Clohessy–Wiltshire relative motion: the exact transition over a time.

    ẍ = 3n²x + 2nẏ,   ÿ = −2nẋ,   z̈ = −n²z      (x radial outward, y along-track, z orbit normal)

Source: Clohessy and Wiltshire, "Terminal Guidance System for Satellite Rendezvous", J. Aerospace Sci. 27 (1960);
the closed form as in Vallado, "Fundamentals of Astrodynamics and Applications", 4th ed., eq. 6-25 (axes as here).
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

SMALL_ANGLE_rad = 0.05


@jit(forceinline=True)
def hcw_transition_row(r, v, mean_motion_rad_s, per_mean_motion_s, sine_half, cosine_half, time_s):
    """Free motion of one chaser over ``time_s``; sine and cosine are of ``n t / 2``.

    Args:
        r: m, 3-tuple, Hill frame.
        v: m/s, 3-tuple, Hill frame.
        mean_motion_rad_s: rad/s, ``n``; ``per_mean_motion_s`` is its inverse, given to spare the division.
        sine_half: ``sin(n t / 2)``; given, because callers need half steps and whole ones.
        cosine_half: ``cos(n t / 2)``.
        time_s: s.

    Returns:
        (r, v) after ``time_s``. ``1 - cos`` is formed as ``2 sin²``, which does not cancel at small ``n t``.
    """
    n, per_n = mean_motion_rad_s, per_mean_motion_s
    sine = 2.0 * sine_half * cosine_half
    versine = 2.0 * sine_half * sine_half
    cosine = 1.0 - versine
    angle = n * time_s
    x = (1.0 + 3.0 * versine) * r[0] + (sine * v[0] + 2.0 * versine * v[1]) * per_n
    y = r[1] + 6.0 * (sine - angle) * r[0] + ((4.0 * sine - 3.0 * angle) * v[1] - 2.0 * versine * v[0]) * per_n
    z = cosine * r[2] + sine * v[2] * per_n
    vx = 3.0 * n * sine * r[0] + cosine * v[0] + 2.0 * sine * v[1]
    vy = (1.0 - 4.0 * versine) * v[1] - 6.0 * n * versine * r[0] - 2.0 * sine * v[0]
    vz = cosine * v[2] - n * sine * r[2]
    return (x, y, z), (vx, vy, vz)


@jit(forceinline=True)
def small_sine_cosine(angle):
    """Sine and cosine of an angle below ``SMALL_ANGLE_rad`` by Taylor series, to the last bit but one."""
    x = angle * angle
    sine = angle * (1.0 - x * (1 / 6 - x * (1 / 120 - x * (1 / 5040))))
    return sine, 1.0 - x * (1 / 2 - x * (1 / 24 - x * (1 / 720 - x * (1 / 40320))))


@jit(forceinline=True)
def sine_cosine(angle):
    """Sine and cosine; the quick series where the angle is small, as orbital angles of a step are."""
    if abs(angle) < SMALL_ANGLE_rad:
        return small_sine_cosine(angle)
    return math.sin(angle), math.cos(angle)


def hcw_transition_matrix(time_s: float, mean_motion_rad_s: float) -> np.ndarray:
    """State transition matrix of (r, v) in Hill axes over ``time_s``, (6, 6); m and m/s."""
    n, half = mean_motion_rad_s, 0.5 * mean_motion_rad_s * time_s
    row = getattr(hcw_transition_row, "py_func", hcw_transition_row)  # the function itself under NUMBA_DISABLE_JIT
    columns = []
    for unit in np.eye(6):
        r, v = row(tuple(unit[:3]), tuple(unit[3:]), n, 1.0 / n, math.sin(half), math.cos(half), time_s)
        columns.append([*r, *v])
    return np.array(columns).T
