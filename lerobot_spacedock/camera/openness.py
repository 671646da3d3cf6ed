"""How open to its surroundings each corner of the scene is: fill light fades in the tunnel and between modules.

Found once for each mesh from depth maps drawn along many directions, and kept in the user's cache folder.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np

from lerobot_spacedock.jit import jit
from lerobot_spacedock.station import StationMesh
from lerobot_spacedock.station.cache import cached_arrays

from .kernels_shadow import draw_depth

DIRECTIONS = 48
MAPS = ((1.6, 384), (0.0, 1024))  # half width about the port m (0: everything), texels a side
FLOOR = 0.12  # light that comes in by second bounces


@jit(nogil=True)
def _accumulate(points, normals, basis, low_u, low_v, per_m, size, depth, push, seen, weight, todo):
    """Add one direction's view of the points that the map holds and that are still to do."""
    for k in range(points.shape[0]):
        if todo[k] == 0:
            continue
        cos = basis[2, 0] * normals[k, 0] + basis[2, 1] * normals[k, 1] + basis[2, 2] * normals[k, 2]
        if cos <= 0.05:
            continue
        x = points[k, 0] + push * normals[k, 0]
        y = points[k, 1] + push * normals[k, 1]
        z = points[k, 2] + push * normals[k, 2]
        u = math.floor((basis[0, 0] * x + basis[0, 1] * y + basis[0, 2] * z - low_u) * per_m)
        v = math.floor((basis[1, 0] * x + basis[1, 1] * y + basis[1, 2] * z - low_v) * per_m)
        if u < 0 or v < 0 or u >= size or v >= size:
            continue
        h = basis[2, 0] * x + basis[2, 1] * y + basis[2, 2] * z
        weight[k] += cos
        if depth[v * size + u] <= h + push:
            seen[k] += cos


def corner_openness(mesh: StationMesh) -> np.ndarray:
    """(F, 3) in 0..1 at the corners, in 255 steps."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.corners).tobytes()).hexdigest()[:12]
    stored = cached_arrays(f"openness-{digest}", __file__, lambda: {"openness": _measure(mesh)})
    return stored["openness"].astype(np.float64) / 255.0


def _measure(mesh: StationMesh) -> np.ndarray:
    corners = np.asarray(mesh.corners, np.float64)
    flat = np.ascontiguousarray(corners.reshape(-1, 9), np.float32)
    # a little inside the triangle, so that a corner in a crease does not look along its neighbour
    inside = (0.85 * corners + 0.15 * corners.mean(axis=1, keepdims=True)).reshape(-1, 3)
    normals = np.ascontiguousarray(mesh.normals.reshape(-1, 3), np.float64)
    near = (np.abs(inside).max(axis=1) < 1.1).astype(np.uint8)
    groups = ((MAPS[0], near), (MAPS[1], (1 - near).astype(np.uint8)))
    seen, weight = np.zeros(len(inside)), np.zeros(len(inside))
    ramp = np.arange(max(size for _, size in MAPS), dtype=np.float32)
    golden = math.pi * (3.0 - math.sqrt(5.0))
    for k in range(DIRECTIONS):
        z = 1.0 - (2.0 * k + 1.0) / DIRECTIONS
        r, a = math.sqrt(1.0 - z * z), golden * k
        d = np.round(np.array([r * math.cos(a), r * math.sin(a), z]), 9)
        helper = np.array([0.0, 0.0, 1.0]) if abs(z) < 0.9 else np.array([1.0, 0.0, 0.0])
        u = np.cross(helper, d)
        u /= math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        basis = np.stack([u, np.cross(d, u), d])
        for (half, size), todo in groups:
            if not todo.any():
                continue
            if half:
                low_u = low_v = -half
                width = 2 * half
            else:
                pu = corners @ basis[0]
                pv = corners @ basis[1]
                low_u, low_v = round(pu.min(), 4) - 0.1, round(pv.min(), 4) - 0.1
                width = max(round(pu.max(), 4) - low_u, round(pv.max(), 4) - low_v) + 0.1
            depth = np.empty(size * size, np.float32)
            draw_depth(flat, basis, low_u, low_v, size / width, size, ramp, depth)
            _accumulate(
                inside, normals, basis, low_u, low_v, size / width, size, depth, 1.2 * width / size, seen, weight, todo
            )
    share = np.where(weight > 0, seen / np.maximum(weight, 1e-9), 1.0)
    share = FLOOR + (1.0 - FLOOR) * share
    return np.floor(np.round(share * 255.0, 6) + 0.5).astype(np.uint8).reshape(-1, 3)
