"""From the samples that ``draw_triangles`` leaves to bytes: the kernels in their order, a few rows of pixels at a time.

Visibility and colour are two calls from Python: one function that held both would have LLVM optimise all of it twice.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.jit import jit

from .kernels_raster import SAMPLE_X_4
from .kernels_resolve import CHUNK, SCRATCH_ROWS, STRIDE, collect, gather, locate
from .kernels_shade import clothe, deposit, encode, lighten, shade_shadow
from .kernels_simd import CELL_SAMPLES, cell_place
from .kernels_sky import paint_sky, paint_stars, project_stars

PIXELS_AT_ONCE = 1280  # so many that chunks of fragments are seldom cut short, so few that they stay in the cache


@jit(nogil=True)
def paint_frame(cells, away, table, materials, texels, maps, cascades, sun_axes, earth, stars, star_gain, light, rot,
                eye, view, width, height, samples, linear, out):  # fmt: skip
    """Colour the samples: into ``out`` (H*W*3 uint8), or into ``linear`` (H*W*3 float32) where that is not empty."""
    rows = max(1, PIXELS_AT_ONCE // width)
    room = rows * width * samples + 8
    frag_surface, frag_pixel = np.empty(room, np.int32), np.empty(room, np.int32)
    frag_x, frag_y, frag_weight = np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.float32)
    sky, colour = np.empty(rows * width, np.float32), np.empty(rows * width * 3, np.float32)
    scratch, taps = np.empty(SCRATCH_ROWS * STRIDE, np.float32), np.empty(4 * STRIDE, np.int32)
    kinds = np.empty(STRIDE, np.int32)
    # fragments are gathered in eights: those after the last one must be of some surface (np.zeros compiles slowly)
    frag_surface[:], kinds[:], taps[:], scratch[:] = 0, 0, 0, np.float32(0.0)
    found, n_stars = np.empty((stars.shape[0], 5)), -1 if star_gain > 0.0 else 0
    for row0 in range(0, height, rows):
        row1 = min(row0 + rows, height)
        values = 3 * (row1 - row0) * width
        colour[:values] = np.float32(0.0)
        fragments = bare = np.int64(0)  # a literal 0 would have ``collect`` compiled twice
        for row in range(row0, row1):
            fragments, more = collect(cells, row, width, samples, SAMPLE_X_4, (row - row0) * width, fragments,
                                      frag_surface, frag_pixel, frag_x, frag_y, frag_weight, sky)  # fmt: skip
            bare += more
        for first in range(0, fragments, CHUNK):
            n = min(CHUNK, fragments - first)
            gather(first, n, frag_surface, away, table, materials, scratch, kinds)
            locate(first, n, frag_x, frag_y, cascades, sun_axes, rot, eye, view, scratch)
            shade_shadow(n, light, maps, scratch, taps)
            clothe(n, texels, scratch, taps)
            lighten(n, light, scratch)
            deposit(first, n, frag_pixel, frag_weight, scratch, colour)
        if bare > 0:
            if n_stars < 0:
                n_stars = project_stars(stars, rot, view, width, height, found)
            paint_sky(row0, row1, width, sky, rot, view, light, earth, colour)
            paint_stars(found, n_stars, row0, row1, width, sky, star_gain, colour)
        first = 3 * row0 * width
        if linear.shape[0] > 0:
            for k in range(values):
                linear[first + k] = colour[k]
        else:
            encode(colour, values, out, first)


@jit(nogil=True)
def read_geometry(cells, segment, width, height, far):
    """Depth along the view axis (H, W) float32 m and segment (H, W) uint8, of samples at the pixels' centres."""
    distance = np.empty((height, width), np.float32)
    what = np.empty((height, width), np.uint8)
    blocks = (width + 7) >> 3
    for i in range(height):
        for j in range(width):
            p = cell_place(i >> 2, j >> 3, blocks) + 8 * (i & 3) + (j & 7)
            shown = cells[p + CELL_SAMPLES]
            if shown < 0:
                distance[i, j], what[i, j] = far, 0
            else:
                distance[i, j], what[i, j] = np.float32(1.0) / np.int32(cells[p]).view(np.float32), segment[shown]
    return distance, what
