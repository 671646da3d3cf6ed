"""Shadow maps: how high the station reaches towards the Sun, in three maps, the finest about the port."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.jit import jit

from .kernels_resolve import (
    C_BLOCKS,
    C_LEVEL_0,
    C_LEVELS,
    C_PUSH,
    C_REACH,
    C_SCALE,
    C_SIZE,
    C_START,
    C_U,
    C_V,
    CASCADE_SIZE,
    SHADOW_BLOCK,
    SHADOW_BLOCK_TILES,
    SHADOW_TILE_U,
    SHADOW_TILE_V,
)
from .surfaces import cross, dot

SHADOW_LAYOUT = ((1.15, 1536), (7.0, 1536), (0.0, 2048))  # half width about the port m (0: all of it), texels a side


@dataclass(frozen=True)
class ShadowMaps:
    """All cascades in one flat array, the tightest first."""

    maps: np.ndarray  # uint16, levels of the height towards the Sun
    cascades: np.ndarray  # (3, 10) float32; columns named by C_SCALE and the like in ``kernels_resolve``
    axes: np.ndarray  # (3, 3) float32; rows are the maps' u and v axes and the direction to the Sun


def draw_shadow_maps(corners: np.ndarray, sun: np.ndarray) -> dict[str, np.ndarray]:
    """Draw every cascade: the arrays of ``ShadowMaps``.

    Args:
        corners: (F, 9) float32 m; three corners of each triangle.
        sun: unit vector to the Sun, (3,).
    """
    from .kernels_shadow import draw_depth

    helper = np.array([0.0, 0.0, 1.0]) if abs(sun[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = cross(helper, sun)
    u = u / np.sqrt(dot(u, u))
    v = cross(sun, u)
    basis = np.stack([u, v, sun])
    points = corners.reshape(-1, 3).astype(np.float64)
    heights = dot(points, sun)
    maps = np.empty(sum(_room(s) for _, s in SHADOW_LAYOUT), np.uint16)
    depth = np.empty(max(s * s for _, s in SHADOW_LAYOUT), np.float32)
    ramp = np.arange(max(s for _, s in SHADOW_LAYOUT), dtype=np.float32)
    cascades = np.zeros((len(SHADOW_LAYOUT), CASCADE_SIZE), np.float32)
    start = 0
    for c, (half, texels) in enumerate(SHADOW_LAYOUT):
        if half > 0.0:
            low_u = low_v = -half
            width = 2.0 * half
            # what the map is asked about lies in a sphere: whatever stands above it counts as being at its top
            low, high = -1.02 * half, 1.02 * half
        else:
            low, high = heights.min() - 0.1, heights.max() + 0.1
            pu, pv = dot(points, u), dot(points, v)
            low_u, low_v = pu.min(), pv.min()
            width = max(pu.max() - low_u, pv.max() - low_v) * 1.01
            low_u, low_v = low_u - 0.005 * width, low_v - 0.005 * width
        per_m = texels / width
        draw_depth(corners, basis, low_u, low_v, per_m, texels, ramp, depth[: texels * texels])
        levels = 65535.0 / (high - low)
        end = start + _room(texels)
        _to_levels(depth[: texels * texels], np.float32(levels), np.float32(low), texels, maps[start:end])
        # bilinear taps sit half a texel in; bias and push hide the staircase of the map on slanted faces
        cascades[c, C_SCALE], cascades[c, C_U], cascades[c, C_V] = per_m, -low_u * per_m - 0.5, -low_v * per_m - 0.5
        cascades[c, C_LEVELS], cascades[c, C_LEVEL_0] = levels, (0.35 / per_m + 2e-4 - low) * levels
        cascades[c, C_PUSH] = 1.6 / per_m
        cascades[c, C_SIZE], cascades[c, C_START] = texels, start
        cascades[c, C_BLOCKS] = _blocks(texels, SHADOW_TILE_U)
        # a sphere about the port lies within its map from every direction; the push needs a little room
        cascades[c, C_REACH] = (0.97 * half) ** 2
        start = end
    return {"maps": maps, "cascades": cascades, "axes": basis.astype(np.float32)}


@jit(nogil=True)
def _to_levels(heights, levels, low, size, out):
    """Heights, m, row by row → 0 .. 65535, rounded down, in blocks of tiles (``SHADOW_TILE_U``)."""
    across, down = SHADOW_BLOCK_TILES * SHADOW_TILE_U, SHADOW_BLOCK_TILES * SHADOW_TILE_V
    place = 0
    for block_v in range(0, size - 1, down):
        for block_u in range(0, size - 1, across):
            for tile_v in range(block_v, block_v + down, SHADOW_TILE_V):
                for tile_u in range(block_u, block_u + across, SHADOW_TILE_U):
                    for v in range(tile_v, tile_v + SHADOW_TILE_V + 1):
                        for u in range(tile_u, tile_u + SHADOW_TILE_U + 1):
                            height = heights[min(v, size - 1) * size + min(u, size - 1)]
                            level = min(max((height - low) * levels, np.float32(0.0)), np.float32(65535.0))
                            out[place] = np.uint16(level)
                            place += 1


def _blocks(texels: int, tile: int) -> int:
    """Blocks along a map's side; the last texel of all begins no tile."""
    return -(-(texels - 1) // (SHADOW_BLOCK_TILES * tile))


def _room(texels: int) -> int:
    """Numbers that a map of so many texels a side takes in blocks."""
    return _blocks(texels, SHADOW_TILE_U) * _blocks(texels, SHADOW_TILE_V) * SHADOW_BLOCK
