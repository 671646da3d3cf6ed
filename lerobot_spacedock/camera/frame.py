"""One frame, from triangles to bytes: the kernels in their order, a band of rows at a time."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.jit import jit

from .kernels_raster import bin_bands, project, scan
from .kernels_shade import (
    CHUNK,
    SCRATCH_ROWS,
    clothe,
    collect,
    deposit,
    encode,
    lighten,
    locate,
    shade_shadow,
    tone_map,
)
from .kernels_sky import paint_sky, paint_stars, project_stars


@jit(nogil=True)
def draw_frame(corners, faces, clusters, spheres, table, materials, texels, maps, map_start, map_size, map_affine,
               map_reach,
               earth, stars, star_gain, light, rot, eye, view, width, height, rows, offsets, xy, plane, linear,
               out):  # fmt: skip
    """Draw into ``out`` (H*W*3 uint8), or into ``linear`` (H*W*3 float32) where that is not empty."""
    samples = offsets.shape[0]
    n = project(corners, faces, clusters, spheres, rot, eye, view, width, height, samples, xy, plane)
    start, items = bin_bands(xy, n, height, rows)
    ramp = np.arange(width).astype(np.float32)
    depth = np.empty(rows * samples * width, np.float32)
    ids = np.empty(rows * samples * width, np.int32)
    room = rows * samples * width
    frag_x, frag_y = np.empty(room, np.float32), np.empty(room, np.float32)
    frag_tri, frag_pixel = np.empty(room, np.int32), np.empty(room, np.int32)
    frag_weight = np.empty(room, np.float32)
    sky = np.empty(rows * width, np.float32)
    colour = np.empty(rows * width * 3, np.float32)
    scratch = np.zeros(SCRATCH_ROWS * CHUNK, np.float32)
    place = np.zeros(2 * CHUNK, np.int64)
    found = np.empty((stars.shape[0], 5))
    n_stars = project_stars(stars, rot, view, width, height, found) if star_gain > 0.0 else 0
    for band in range(start.shape[0] - 1):
        row0 = band * rows
        row1 = min(row0 + rows, height)
        pixels = (row1 - row0) * width
        colour[: 3 * pixels] = np.float32(0.0)
        depth[: pixels * samples] = np.float32(0.0)
        ids[: pixels * samples] = -1
        scan(xy, plane, items, start[band], start[band + 1], row0, row1, width, samples, offsets, ramp, depth, ids)
        count = collect(ids, row0, row1, width, samples, offsets, frag_x, frag_y, frag_tri, frag_pixel,
                        frag_weight, sky)  # fmt: skip
        for k0 in range(0, count, CHUNK):
            m = min(CHUNK, count - k0)
            locate(k0, m, frag_x, frag_y, frag_tri, plane, table, materials, rot, eye, view, scratch)
            shade_shadow(m, light, maps, map_start, map_size, map_affine, map_reach, scratch, place)
            clothe(m, materials, texels, scratch)
            lighten(m, light, scratch)
            tone_map(m, scratch)
            deposit(k0, m, frag_pixel, frag_weight, scratch, colour)
        paint_sky(row0, row1, width, sky, rot, view, light, earth, colour)
        if n_stars > 0:
            paint_stars(found, n_stars, row0, row1, width, sky, star_gain, colour)
        first = 3 * row0 * width
        if linear.shape[0] > 0:
            linear[first : first + 3 * pixels] = colour[: 3 * pixels]
        else:
            encode(colour, 3 * pixels, out, first)


@jit(nogil=True)
def draw_geometry(corners, faces, clusters, spheres, segment, rot, eye, view, width, height, far, xy, plane):
    """Depth along the view axis (H, W) float32 m and segment (H, W) uint8 at each pixel's centre."""
    offsets = np.array([0.5])
    n = project(corners, faces, clusters, spheres, rot, eye, view, width, height, 1, xy, plane)
    start, items = bin_bands(xy, n, height, height)
    ramp = np.arange(width).astype(np.float32)
    depth = np.zeros(height * width, np.float32)
    ids = np.full(height * width, -1, np.int32)
    scan(xy, plane, items, start[0], start[1], 0, height, width, 1, offsets, ramp, depth, ids)
    what = np.zeros(height * width, np.uint8)
    for p in range(height * width):
        if ids[p] < 0:
            depth[p] = far
        else:
            depth[p] = np.float32(1.0) / depth[p]
            what[p] = segment[int(plane[ids[p], 3])]
    return depth.reshape(height, width), what.reshape(height, width)
