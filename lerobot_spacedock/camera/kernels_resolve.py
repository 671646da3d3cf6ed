"""From samples to fragments: what each row of pixels shows, and where on the station it is.

A fragment is one surface's share of one pixel. A surface is a set of triangles in one plane over which normal, texture
place and openness are affine in position (``surfaces.py``), so its row of numbers and the ray of the pixel are all that
is needed to find them. Fragments of one surface usually stand side by side, but small pictures have about as many
surfaces as fragments: the rows of eight fragments are therefore turned on their side with eight-wide loads, whichever
surfaces they are, and from there on everything is arithmetic over a chunk of fragments.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import inner

from .kernels_fetch import fetch_ahead, turn_rows
from .kernels_simd import CELL_SAMPLES, cell_place, pure_columns

CHUNK = 128  # fragments that are shaded together: the scratch array then stays in the first-level cache
STRIDE = CHUNK + 8  # fragments are gathered in eights, the last of them over its end

# Rows of the scratch array. The first 32 are the columns of the surface table, the next 16 those of the material table;
# what is found for a fragment takes the place of what it was found from.
SURFACE_SIZE, MATERIAL_SIZE = 32, 16
T_N, T_U, T_V, T_AO, T_KIND, T_BOTH, T_PLANE = 0, 12, 16, 20, 24, 25, 26
(M_BASE, M_SECOND, M_ROUGH, M_F0, M_METAL, M_SCALE, M_BUMP, M_PATTERN, M_EMIT, M_TINT) = (
    0, 3, 6, 7, 8, 9, 10, 11, 12, 13)  # fmt: skip
NX, NY, NZ, VX, VY, VZ, DIST, FOOT, FU, FV, HIGH, TEXEL = range(12)
TU, UX, UY, UZ, TV, WX, WY, WZ, AO, SUN = range(12, 22)
_MATERIAL = SURFACE_SIZE
AR, AG, AB, SR, SG, SB = (_MATERIAL + k for k in range(6))
ROUGH, F0, METAL, BUMP, PATTERN, EMIT, TINT = (
    _MATERIAL + k for k in (M_ROUGH, M_F0, M_METAL, M_BUMP, M_PATTERN, M_EMIT, M_TINT)
)
_SCALE = _MATERIAL + M_SCALE
_AWAY = SURFACE_SIZE + MATERIAL_SIZE  # distance of the camera from the surface's plane
SCRATCH_ROWS = _AWAY + 1

# Texels along a pattern's side; then its mip levels, the level of side s at place s² + s. Each row is repeated by one
# texel at its end, so that two neighbours always stand side by side.
TILE = 256
LEVELS = 9
PATTERN_TEXELS = 2 * TILE * (TILE + 1)

# columns of the cascade table: texels a metre, offsets of u and v; levels a metre and the level of height 0, bias
# included; push along the normal; texels a side, blocks a side, first texel; squared distance from the port up to which
# it is good
C_SCALE, C_U, C_V, C_LEVELS, C_LEVEL_0, C_PUSH, C_SIZE, C_BLOCKS, C_START, C_REACH = range(10)
CASCADE_SIZE = 10

# A map lies in memory in tiles of 8 x 4 texels, one line of the processor's cache each. A tile repeats the first column
# and the first row of its neighbours, so that the four texels about a point are in one tile. Blocks of 8 x 8 tiles fill
# a page of memory.
SHADOW_TILE_U, SHADOW_TILE_V = 7, 3
SHADOW_TILE = (SHADOW_TILE_U + 1) * (SHADOW_TILE_V + 1)
SHADOW_BLOCK_TILES = 8
SHADOW_BLOCK = SHADOW_BLOCK_TILES * SHADOW_BLOCK_TILES * SHADOW_TILE


@inner
def collect(cells, row, width, samples, off_x, pixel0, n, frag_surface, frag_pixel, frag_x, frag_y, frag_weight, sky):
    """List the fragments of one row of pixels after the ``n`` that are there; → their number, and that of sky pixels.

    ``sky`` gets the share of each pixel where nothing was hit, from place ``pixel0`` on. A fragment stands at its
    pixel's centre, or at the centroid of its samples where it has only a share of the pixel.
    """
    blocks = (width + 7) >> 3
    step = 8 if samples == 4 else 0
    group, inside = (row, CELL_SAMPLES) if samples == 4 else (row >> 2, CELL_SAMPLES + 8 * (row & 3))
    middle, half = np.float32(row + 0.5), np.float32(0.5)
    one, zero = np.float32(1.0), np.float32(0.0)
    bare = 0
    for block in range(blocks):
        place = cell_place(group, block, blocks) + inside
        column = 8 * block
        pixel = pixel0 + column
        count = min(8, width - column)
        found = pure_columns(cells, place, step)
        fetch_ahead(cells, cell_place(group + 1, block, blocks))  # cells of one row are far apart in memory
        pure, empty = found & 255, found >> 8
        if pure == 255 and count == 8 and (empty == 0 or empty == 255):
            if empty:
                for j in range(np.uint64(8)):
                    sky[np.uint64(pixel) + j] = one
                bare += 8
                continue
            surface, where = frag_surface[n : n + 8], frag_pixel[n : n + 8]
            for j in range(np.uint64(8)):
                surface[j] = cells[np.uint64(place) + j]
            for j in range(np.uint64(8)):
                where[j] = np.int32(np.int32(pixel) + np.int32(j))
            for j in range(np.uint64(8)):
                frag_x[np.uint64(n) + j] = np.float32(np.int32(np.int32(column) + np.int32(j))) + half
            for j in range(np.uint64(8)):
                frag_y[np.uint64(n) + j] = middle
            for j in range(np.uint64(8)):
                frag_weight[np.uint64(n) + j] = one
            for j in range(np.uint64(8)):
                sky[np.uint64(pixel) + j] = zero
            n += 8
            continue
        for j in range(count):
            t = cells[np.uint64(place + j)]
            if (pure >> j) & 1:
                sky[pixel + j] = one if t < 0 else zero
                bare += t < 0
                if t >= 0:
                    frag_surface[n], frag_pixel[n], frag_weight[n] = t, pixel + j, one
                    frag_x[n], frag_y[n] = np.float32(column + j) + half, middle
                    n += 1
                continue
            hollow = 0
            for s in range(4):
                t = cells[np.uint64(place + j + 8 * s)]
                if t < 0:
                    hollow += 1
                    continue
                seen = False
                for r in range(s):
                    seen |= cells[np.uint64(place + j + 8 * r)] == t
                if seen:
                    continue
                hits = 0
                x = y = zero
                for r in range(s, 4):
                    if cells[np.uint64(place + j + 8 * r)] == t:
                        hits += 1
                        x += np.float32(off_x[r])
                        y += np.float32(0.25 * r + 0.125)
                share = one / np.float32(hits)
                frag_surface[n], frag_pixel[n] = t, pixel + j
                frag_x[n], frag_y[n] = np.float32(column + j) + x * share, np.float32(row) + y * share
                frag_weight[n] = np.float32(0.25) * np.float32(hits)
                n += 1
            sky[pixel + j] = np.float32(0.25) * np.float32(hollow)
            bare += hollow > 0
    return n, bare


@inner
def gather(first, n, frag_surface, away, table, materials, s, kinds):
    """Bring the rows of ``n`` fragments' surfaces and materials into the scratch array, from fragment ``first`` on."""
    for k in range(0, n, 8):
        for part in range(SURFACE_SIZE // 8):
            turn_rows(table, SURFACE_SIZE, frag_surface, first + k, 8 * part, s, (8 * part) * STRIDE + k, STRIDE)
    for k in range(np.uint64(n)):
        s[_AWAY * STRIDE + k] = away[np.uint32(frag_surface[np.uint64(first) + k])]
    for k in range(np.uint64(n)):
        kinds[k] = np.int32(s[T_KIND * STRIDE + k])
    for k in range(0, n, 8):
        for part in range(MATERIAL_SIZE // 8):
            to = (_MATERIAL + 8 * part) * STRIDE + k
            turn_rows(materials, MATERIAL_SIZE, kinds, k, 8 * part, s, to, STRIDE)


@inner
def locate(first, n, frag_x, frag_y, cascades, sun_axes, rot, eye, view, s):
    """Find position, normal, texture and shadow map places of ``n`` gathered fragments.

    Args:
        first: place of the first in ``frag_x`` and ``frag_y``, which hold pixels.
        cascades: (3, 9) float32, see C_SCALE.
        sun_axes: (3, 3) float32; rows are the shadow maps' u and v axes and the direction to the Sun.
        rot, eye, view: the camera, as in ``draw_triangles``.
        s: the scratch array.
    """
    f32 = np.float32
    one, zero, half = f32(1.0), f32(0.0), f32(0.5)
    ex, ey, ez = f32(eye[0]), f32(eye[1]), f32(eye[2])
    inv_fx, inv_fy = f32(1.0 / view[0]), f32(1.0 / view[1])
    cx, cy = f32(view[2]), f32(view[3])
    r00, r01, r02 = f32(rot[0, 0]), f32(rot[0, 1]), f32(rot[0, 2])
    r10, r11, r12 = f32(rot[1, 0]), f32(rot[1, 1]), f32(rot[1, 2])
    r20, r21, r22 = f32(rot[2, 0]), f32(rot[2, 1]), f32(rot[2, 2])
    grain = inv_fx * f32(TILE)
    ux, uy, uz = sun_axes[0, 0], sun_axes[0, 1], sun_axes[0, 2]
    vx, vy, vz = sun_axes[1, 0], sun_axes[1, 1], sun_axes[1, 2]
    sx, sy, sz = sun_axes[2, 0], sun_axes[2, 1], sun_axes[2, 2]
    near_map, middle_map, whole_map = cascades[0], cascades[1], cascades[2]
    a_scale, a_u, a_v, a_levels, a_level = near_map[0], near_map[1], near_map[2], near_map[3], near_map[4]
    a_push, a_size, a_blocks, a_start, a_reach = near_map[5], near_map[6], near_map[7], near_map[8], near_map[9]
    b_scale, b_u, b_v, b_levels, b_level = middle_map[0], middle_map[1], middle_map[2], middle_map[3], middle_map[4]
    b_push, b_size, b_blocks, b_start, b_reach = (
        middle_map[5], middle_map[6], middle_map[7], middle_map[8], middle_map[9])  # fmt: skip
    c_scale, c_u, c_v, c_levels, c_level = whole_map[0], whole_map[1], whole_map[2], whole_map[3], whole_map[4]
    c_push, c_size, c_blocks, c_start = whole_map[5], whole_map[6], whole_map[7], whole_map[8]
    per_u, per_v = f32(1.0 / SHADOW_TILE_U), f32(1.0 / SHADOW_TILE_V)
    xs, ys = frag_x[first : first + n], frag_y[first : first + n]
    for k in range(np.uint64(n)):
        dx, dy = (xs[k] - cx) * inv_fx, (ys[k] - cy) * inv_fy
        rx, ry, rz = r00 * dx + r10 * dy + r20, r01 * dx + r11 * dy + r21, r02 * dx + r12 * dy + r22
        slant = s[T_PLANE * STRIDE + k] * rx + s[(T_PLANE + 1) * STRIDE + k] * ry + s[(T_PLANE + 2) * STRIDE + k] * rz
        z = s[_AWAY * STRIDE + k] / slant
        px, py, pz = ex + z * rx, ey + z * ry, ez + z * rz
        nx = s[0 * STRIDE + k] + s[3 * STRIDE + k] * px + s[4 * STRIDE + k] * py + s[5 * STRIDE + k] * pz
        ny = s[1 * STRIDE + k] + s[6 * STRIDE + k] * px + s[7 * STRIDE + k] * py + s[8 * STRIDE + k] * pz
        nz = s[2 * STRIDE + k] + s[9 * STRIDE + k] * px + s[10 * STRIDE + k] * py + s[11 * STRIDE + k] * pz
        ray = math.sqrt(rx * rx + ry * ry + rz * rz)
        toward = nx * rx + ny * ry + nz * rz
        sign = f32(-1.0) if s[T_BOTH * STRIDE + k] * toward > zero else one
        nx, ny, nz = nx * sign, ny * sign, nz * sign
        back = -one / ray
        s[NX * STRIDE + k], s[NY * STRIDE + k], s[NZ * STRIDE + k] = nx, ny, nz
        s[VX * STRIDE + k], s[VY * STRIDE + k], s[VZ * STRIDE + k] = rx * back, ry * back, rz * back
        s[DIST * STRIDE + k] = z * ray
        scale = s[_SCALE * STRIDE + k]
        s[TU * STRIDE + k] = scale * (
            s[TU * STRIDE + k] + s[UX * STRIDE + k] * px + s[UY * STRIDE + k] * py + s[UZ * STRIDE + k] * pz
        )
        s[TV * STRIDE + k] = scale * (
            s[TV * STRIDE + k] + s[WX * STRIDE + k] * px + s[WY * STRIDE + k] * py + s[WZ * STRIDE + k] * pz
        )
        s[FOOT * STRIDE + k] = z * grain * scale / max(abs(toward * back), f32(0.3))
        ao = s[20 * STRIDE + k] + s[21 * STRIDE + k] * px + s[22 * STRIDE + k] * py + s[23 * STRIDE + k] * pz
        # the finest of the Sun's maps that holds this point
        far = px * px + py * py + pz * pz
        m_scale = a_scale if far <= a_reach else (b_scale if far <= b_reach else c_scale)
        m_u = a_u if far <= a_reach else (b_u if far <= b_reach else c_u)
        m_v = a_v if far <= a_reach else (b_v if far <= b_reach else c_v)
        m_levels = a_levels if far <= a_reach else (b_levels if far <= b_reach else c_levels)
        m_level = a_level if far <= a_reach else (b_level if far <= b_reach else c_level)
        push = a_push if far <= a_reach else (b_push if far <= b_reach else c_push)
        size = a_size if far <= a_reach else (b_size if far <= b_reach else c_size)
        blocks = a_blocks if far <= a_reach else (b_blocks if far <= b_reach else c_blocks)
        start = a_start if far <= a_reach else (b_start if far <= b_reach else c_start)
        # where it holds it, pushed off the surface
        px, py, pz = px + nx * push, py + ny * push, pz + nz * push
        edge = size - f32(2.0)
        u = min(max((ux * px + uy * py + uz * pz) * m_scale + m_u, zero), edge)
        v = min(max((vx * px + vy * py + vz * pz) * m_scale + m_v, zero), edge)
        iu, iv = f32(np.int32(u)), f32(np.int32(v))
        high = (sx * px + sy * py + sz * pz) * m_levels + m_level
        s[FU * STRIDE + k], s[FV * STRIDE + k] = u - iu, v - iv
        # below everything, so dark, where it is turned away
        s[HIGH * STRIDE + k] = high if nx * sx + ny * sy + nz * sz > zero else f32(-2e9)
        tu, tv = np.int32((iu + half) * per_u), np.int32((iv + half) * per_v)
        within = (iv - f32(tv) * f32(SHADOW_TILE_V)) * f32(SHADOW_TILE_U + 1) + (iu - f32(tu) * f32(SHADOW_TILE_U))
        block = f32(tv >> np.int32(3)) * blocks + f32(tu >> np.int32(3))
        tile = f32(((tv & np.int32(7)) << np.int32(3)) + (tu & np.int32(7)))
        s[TEXEL * STRIDE + k] = start + block * f32(SHADOW_BLOCK) + (tile * f32(SHADOW_TILE) + within)
        s[AO * STRIDE + k] = min(max(ao, zero), one)
