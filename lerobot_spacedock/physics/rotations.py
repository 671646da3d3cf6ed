"""Quaternions over batches: scalar first, unit norm, ``q_AB`` turns B vectors into A vectors (see ``frames.py``).

Every function takes arrays whose last axis is the component axis and broadcasts over the axes before it.
"""

from __future__ import annotations

import numpy as np


def multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton product ``p ⊗ q``: ``multiply(q_AB, q_BC) = q_AC``. (..., 4), (..., 4) → (..., 4)."""
    p, q = np.asarray(p, dtype=np.float64), np.asarray(q, dtype=np.float64)
    p0, p1, p2, p3 = np.moveaxis(p, -1, 0)
    q0, q1, q2, q3 = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
            p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
            p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
        ],
        axis=-1,
    )


def conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse rotation of a unit quaternion. (..., 4) → (..., 4)."""
    return np.asarray(q, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0])


def normalize(q: np.ndarray) -> np.ndarray:
    """Unit quaternion(s) along ``q``; a zero quaternion gives NaN, which callers must have refused. (..., 4)."""
    q = np.asarray(q, dtype=np.float64)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def rotate(q_AB: np.ndarray, v_B: np.ndarray) -> np.ndarray:
    """B vectors expressed in A. (..., 4), (..., 3) → (..., 3)."""
    q_AB, v_B = np.asarray(q_AB, dtype=np.float64), np.asarray(v_B, dtype=np.float64)
    scalar, vector = q_AB[..., :1], q_AB[..., 1:]
    twice_cross = 2.0 * np.cross(vector, v_B)
    return v_B + scalar * twice_cross + np.cross(vector, twice_cross)


def rotate_inverse(q_AB: np.ndarray, v_A: np.ndarray) -> np.ndarray:
    """A vectors expressed in B. (..., 4), (..., 3) → (..., 3)."""
    return rotate(conjugate(q_AB), v_A)


def from_rotation_vector(rotation_rad: np.ndarray) -> np.ndarray:
    """Quaternion of a rotation vector (axis times angle, rad). (..., 3) → (..., 4)."""
    rotation_rad = np.asarray(rotation_rad, dtype=np.float64)
    half = 0.5 * np.linalg.norm(rotation_rad, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * rotation_rad * np.sinc(half / np.pi)], axis=-1)


def to_rotation_vector(q: np.ndarray) -> np.ndarray:
    """Rotation vector of the shorter way round, rad, norm at most pi. (..., 4) → (..., 3)."""
    q = np.asarray(q, dtype=np.float64)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, q[..., :1])
    return 2.0 * q[..., 1:] / np.where(sine > 0.0, np.sinc(half / np.pi), 1.0)
