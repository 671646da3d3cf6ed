"""Triangles that can be shaded as one: neighbours in one plane, over which normal, texture and openness are affine.

The two halves of a facet, the slices of a disc, the pieces of a wall: a pixel that shows several of them shows one
surface, and pays for one.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.jit import inner, jit

PLANE_m = 1e-4  # a corner farther than this from the first triangle's plane is in another plane
# how far a corner may stray from the first triangle's affine functions, which are then fitted anew to all corners
NORMAL, OPENNESS, TEXTURE_m = 0.04, 0.2, 0.02
CHANNELS = 6  # normal, u, v, openness


def find_surfaces(corners: np.ndarray, values: np.ndarray, plane: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """The surface of each triangle (F,) int64: the number of the triangle that it was grown from.

    Args:
        corners: m, (F, 3, 3).
        values: (F, 3, 6) normal, u and v in metres (0 where there is no texture) and openness at the corners.
        plane: (F, 4) unit normal and offset.
        kind: (F,) whole numbers; triangles of different kinds are never joined.
    """
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = dot(cross(e1, e2), cross(e1, e2))
    order = np.argsort(-np.round(area, 9), kind="stable")
    functions = affine(corners, values)
    surface, stack = np.full(len(order), -1), np.empty(3 * len(order) + 3, np.int64)
    _grow(order, _neighbours(corners), corners, values, functions, plane, kind, surface, stack)
    return surface


def affine(corners: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at corners (F, 3, C) → constant and gradient over position, (F, C, 4).

    The gradient lies in the triangle's plane. Written out, so that no BLAS of another CPU can change a bit.
    """
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d11, d12, d22 = dot(e1, e1), dot(e1, e2), dot(e2, e2)
    det = np.maximum(d11 * d22 - d12 * d12, 1e-24)
    g1 = (d22[:, None] * e1 - d12[:, None] * e2) / det[:, None]
    g2 = (d11[:, None] * e2 - d12[:, None] * e1) / det[:, None]
    rise1, rise2 = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    gradient = rise1[:, :, None] * g1[:, None] + rise2[:, :, None] * g2[:, None]
    constant = values[:, 0] - dot(gradient, corners[:, None, 0])
    return np.concatenate([constant[..., None], gradient], -1)


def fit(surface: np.ndarray, corners: np.ndarray, values: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Least-squares affine functions of values over each surface's corners, (S, C, 4) constant and gradient.

    Args:
        surface: (F,) number of each triangle's surface, 0 .. S-1.
        corners: m, (F, 3, 3).
        values: (F, 3, C).
        normal: unit, (S, 3), the surfaces' planes; the gradients lie in them.
    """
    of = np.repeat(surface, 3)
    total = lambda x: np.bincount(of, x, len(normal))  # noqa: E731
    points, value = corners.reshape(-1, 3), values.reshape(len(of), -1)
    n = total(np.ones(len(of)))
    middle = np.stack([total(points[:, k]) for k in range(3)], -1) / n[:, None]
    helper = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    a = cross(normal, helper)
    a = a / np.sqrt(dot(a, a))[:, None]
    b = cross(normal, a)
    away = points - middle[of]
    x, y = dot(away, a[of]), dot(away, b[of])
    xx, xy, yy = total(x * x), total(x * y), total(y * y)
    det = np.maximum(xx * yy - xy * xy, 1e-24)
    out = np.empty((len(normal), value.shape[1], 4))
    for c in range(value.shape[1]):
        mean = total(value[:, c]) / n
        rise = value[:, c] - mean[of]
        xv, yv = total(x * rise), total(y * rise)
        gradient = ((yy * xv - xy * yv) / det)[:, None] * a + ((xx * yv - xy * xv) / det)[:, None] * b
        out[:, c, 0], out[:, c, 1:] = mean - dot(gradient, middle), gradient
    return out


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Inner product over the last axis, summed in the same order on every machine."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        -1,
    )


def corner_numbers(corners: np.ndarray) -> np.ndarray:
    """(F, 3) int64: equal where corners are in one place."""
    grid = np.round(corners.reshape(-1, 3) * 1e5).astype(np.int64)
    order = np.lexsort(grid.T)
    new = np.append(True, (np.diff(grid[order], axis=0) != 0).any(1))
    number = np.empty(len(grid), np.int64)
    number[order] = np.cumsum(new) - 1
    return number.reshape(-1, 3)


def _neighbours(corners: np.ndarray) -> np.ndarray:
    """(F, 3) int64: the triangle beyond each edge, or -1 where there is none or more than one."""
    number = corner_numbers(corners)
    a, b = number.reshape(-1), np.roll(number, -1, axis=1).reshape(-1)
    key = np.minimum(a, b) * (number.max() + 1) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.append(True, np.diff(key[order]) != 0))
    i = starts[np.diff(np.append(starts, len(key))) == 2]
    out = np.full(len(key), -1, np.int64)
    out[order[i]], out[order[i + 1]] = order[i + 1] // 3, order[i] // 3
    return out.reshape(-1, 3)


@jit
def _grow(order, neighbours, corners, values, functions, plane, kind, surface, stack):
    """Grow a surface from each triangle that has none yet (-1), over neighbours that keep to its functions."""
    for seed in order:
        if surface[seed] >= 0:
            continue
        surface[seed] = seed
        stack[0] = seed
        height = 1
        while height > 0:
            height -= 1
            here = stack[height]
            for side in range(3):
                there = neighbours[here, side]
                if there < 0 or surface[there] >= 0 or kind[there] != kind[seed]:
                    continue
                if not _keeps_to(seed, there, corners, values, functions, plane):
                    continue
                surface[there] = seed
                stack[height] = there
                height += 1


@inner
def _keeps_to(seed, there, corners, values, functions, plane):
    faces = 0.0
    for k in range(3):
        faces += plane[seed, k] * plane[there, k]
    if faces < 0.99:
        return False
    for c in range(3):
        x, y, z = corners[there, c, 0], corners[there, c, 1], corners[there, c, 2]
        away = plane[seed, 0] * x + plane[seed, 1] * y + plane[seed, 2] * z - plane[seed, 3]
        if abs(away) > PLANE_m:
            return False
        for v in range(CHANNELS):
            f = functions[seed, v]
            error = abs(f[0] + f[1] * x + f[2] * y + f[3] * z - values[there, c, v])
            if error > (NORMAL if v < 3 else TEXTURE_m if v < 5 else OPENNESS):
                return False
    return True
