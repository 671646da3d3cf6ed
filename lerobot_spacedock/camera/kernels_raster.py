"""Visibility: cull, project and clip triangles, and scan-convert them into cells of samples, near clusters first.

Depth is kept as 1/z (metres⁻¹), which is affine in the image plane and larger when nearer. Edges run from their upper
to their lower end in double precision, so two triangles that share an edge agree on every sample bit for bit. No
fast-math and no libm: the same input gives the same bytes on every x86-64 CPU.

Now and then, while the picture fills, the depth of the farthest sample of each tile is noted. A cluster or a triangle
that lies wholly behind those depths cannot change a sample, so passing it over changes no picture.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

from .kernels_simd import CELL, farthest, fill_cells

SAMPLE_X_4 = (0.375, 0.875, 0.125, 0.625)  # rotated grid: sample rows are 1/4 pixel apart, columns all differ
TILE_CELLS = 8  # cells, one above the other, of which one farthest depth is kept
LOOK_BACK = (0.12, 0.3, 0.55)  # shares of the clusters after which those depths are found anew


def tiles_of(width: int, height: int, samples: int) -> int:
    """Tiles of a picture."""
    groups = (height * samples + 3) >> 2
    return ((width + 7) >> 3) * ((groups + TILE_CELLS - 1) // TILE_CELLS)


@jit(nogil=True)
def order_clusters(spheres, cones, rot, eye, view, width, height, kept, near):
    """Clusters that may be in the picture, nearest first → their number; ``near`` gets each one's nearest depth, m."""
    fx, fy, cx, cy, clip = view[0], view[1], view[2], view[3], view[4]
    left, right = cx / fx, (width - cx) / fx
    top, bottom = cy / fy, (height - cy) / fy
    norm_l, norm_r = math.sqrt(1.0 + left * left), math.sqrt(1.0 + right * right)
    norm_t, norm_b = math.sqrt(1.0 + top * top), math.sqrt(1.0 + bottom * bottom)
    n = 0
    for k in range(spheres.shape[0]):
        dx, dy, dz = spheres[k, 0] - eye[0], spheres[k, 1] - eye[1], spheres[k, 2] - eye[2]
        radius = float(spheres[k, 3])
        x = rot[0, 0] * dx + rot[0, 1] * dy + rot[0, 2] * dz
        y = rot[1, 0] * dx + rot[1, 1] * dy + rot[1, 2] * dz
        z = rot[2, 0] * dx + rot[2, 1] * dy + rot[2, 2] * dz
        if (
            z < clip - radius
            or -x - left * z > radius * norm_l
            or x - right * z > radius * norm_r
            or -y - top * z > radius * norm_t
            or y - bottom * z > radius * norm_b
        ):
            continue
        away = math.sqrt(dx * dx + dy * dy + dz * dz)
        if cones[k, 0] * dx + cones[k, 1] * dy + cones[k, 2] * dz > cones[k, 3] * away + radius:
            continue  # every face is turned away
        kept[n], near[n] = k, z - radius
        n += 1
    order = np.argsort(near[:n])
    near[:n] = near[:n][order]
    kept[:n] = kept[:n][order]
    return n


@jit(nogil=True)
def _look_back(depth, blocks, groups, floors, across):
    """Find the farthest depth of each tile."""
    for tile_row in range(floors.shape[0] // across):
        g0, g1 = tile_row * TILE_CELLS, min((tile_row + 1) * TILE_CELLS, groups)
        for b in range(across):
            floors[tile_row * across + b] = farthest(depth, (g0 * blocks + b) * CELL, blocks * CELL, g1 - g0)


@jit(nogil=True, forceinline=True)
def _hidden(floors, across, x0, x1, y0, y1, per_tile, w):
    """Whether something at 1/z ≤ w within the given pixels lies behind all that is drawn there."""
    down = floors.shape[0] // across
    i0, i1 = int(min(max(y0, 0.0) / per_tile, down - 1.0)), int(min(max(y1, 0.0) / per_tile, down - 1.0))
    j0, j1 = int(min(max(x0, 0.0), across * 8.0 - 1.0)) >> 3, int(min(max(x1, 0.0), across * 8.0 - 1.0)) >> 3
    far = np.float32(w * 1.00001)  # samples are affine in float32: leave it room
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if floors[i * across + j] < far:
                return False
    return True


@jit(nogil=True)
def _cluster_hidden(sphere, rot, eye, view, floors, across, per_tile):
    dx, dy, dz = sphere[0] - eye[0], sphere[1] - eye[1], sphere[2] - eye[2]
    radius = float(sphere[3])
    z = rot[2, 0] * dx + rot[2, 1] * dy + rot[2, 2] * dz
    near, far = z - radius, z + radius
    if near <= view[4]:
        return False
    x = rot[0, 0] * dx + rot[0, 1] * dy + rot[0, 2] * dz
    y = rot[1, 0] * dx + rot[1, 1] * dy + rot[1, 2] * dz
    left, right, top, bottom = x - radius, x + radius, y - radius, y + radius
    u0 = view[2] + view[0] * left / (near if left < 0.0 else far)
    u1 = view[2] + view[0] * right / (near if right > 0.0 else far)
    v0 = view[3] + view[1] * top / (near if top < 0.0 else far)
    v1 = view[3] + view[1] * bottom / (near if bottom > 0.0 else far)
    return _hidden(floors, across, u0, u1, v0, v1, per_tile, 1.0 / near)


@jit(nogil=True, forceinline=True)
def _fill(p, i, f, n, width, height, samples, offsets, blocks, groups, floors, across, looked, depth, ids, plane):
    """Scan-convert one projected triangle (x, y, 1/z of three corners) → number of triangles so far."""
    ax, ay, aw = p[i, 0], p[i, 1], p[i, 2]
    bx, by, bw = p[i, 3], p[i, 4], p[i, 5]
    cx, cy, cw = p[i, 6], p[i, 7], p[i, 8]
    if ay > by:
        ax, ay, aw, bx, by, bw = bx, by, bw, ax, ay, aw
    if by > cy:
        bx, by, bw, cx, cy, cw = cx, cy, cw, bx, by, bw
    if ay > by:
        ax, ay, aw, bx, by, bw = bx, by, bw, ax, ay, aw
    x_low, x_high = min(ax, bx, cx), max(ax, bx, cx)
    if cy <= 0.0 or ay >= height or x_high <= 0.0 or x_low >= width:
        return n
    # samples stand on a lattice of ``grain`` a pixel: a speck that holds no row or column of it leaves no trace
    grain = float(samples)
    if math.ceil(x_low * grain - 0.5) == math.ceil(x_high * grain - 0.5):
        return n
    first = math.ceil(max(ay * grain - 0.5, 0.0))
    end = math.ceil(min(cy * grain - 0.5, height * grain))
    if first >= end:
        return n
    if looked and _hidden(floors, across, x_low, x_high, ay, cy, 4.0 * TILE_CELLS / grain, max(aw, bw, cw)):
        return n
    det = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if not abs(det) > 1e-9:
        return n
    inv = 1.0 / det
    gx = ((bw - aw) * (cy - ay) - (cw - aw) * (by - ay)) * inv
    gy = ((cw - aw) * (bx - ax) - (bw - aw) * (cx - ax)) * inv
    g0 = aw - gx * ax - gy * ay
    plane[n, 0], plane[n, 1], plane[n, 2], plane[n, 3] = gx, gy, g0, f
    slopes = (
        (cx - ax) / (cy - ay),
        (bx - ax) / (by - ay) if by > ay else 0.0,
        (cx - bx) / (cy - by) if cy > by else 0.0,
    )
    corners, affine = (ax, ay, bx, by, cy), (gx, gy, g0)
    step = 1.0 / grain
    for g in range(int(first) >> 2, (int(end) + 3) >> 2):
        fill_cells(depth, ids, g * blocks * CELL, width, corners, slopes, affine, (4 * g + 0.5) * step, step,
                   offsets, n)  # fmt: skip
    return n + 1


@jit(nogil=True)
def draw_triangles(corners, planes, clusters, spheres, cones, rot, eye, view, width, height, samples, depth, ids, plane,
                   floors):  # fmt: skip
    """Cull by cluster, face and what is already drawn; transform, clip at the near plane, project and fill.

    Args:
        corners: (F, 9) float32 m; three corners of each triangle.
        planes: (F, 5) float32; outward unit normal, offset (n·p), and 1 where both sides are seen.
        clusters: (K, 2) int32; first triangle and one past the last.
        spheres: (K, 4) float32; centre and radius, m.
        cones: (K, 4) float32; axis of a cone that holds the normals and the sine of its half angle, or 2.
        rot: (3, 3) float64; rows are the camera's right, down and forward axes.
        eye: (3,) float64 m.
        view: (5,) float64; fx, fy, cx, cy in pixels and the near distance in metres.
        samples: samples a pixel, 1 or 4.
        depth, ids: outputs, flat, cells of 32 samples (``kernels_simd``); 1/z and number of the triangle drawn, or -1.
        plane: output, (2F, 4) float64: 1/z as an affine function of column and row, and the scene's triangle.
        floors: room for a float32 a tile.
    """
    blocks = (width + 7) >> 3
    groups = (height * samples + 3) >> 2
    depth[: groups * blocks * CELL] = np.float32(0.0)
    ids[: groups * blocks * CELL] = -1
    tiles = floors[: blocks * ((groups + TILE_CELLS - 1) // TILE_CELLS)]
    offsets = (0.375, 0.875, 0.125, 0.625) if samples == 4 else (0.5, 0.5, 0.5, 0.5)
    per_tile = 4.0 * TILE_CELLS / samples
    fx, fy, cx, cy, near = view[0], view[1], view[2], view[3], view[4]
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    ex, ey, ez = eye[0], eye[1], eye[2]
    px, py, pz = np.empty(3), np.empty(3), np.empty(3)
    shape = np.empty((2, 9))
    kept, nearest = np.empty(len(clusters), np.int64), np.empty(len(clusters))
    count = order_clusters(spheres, cones, rot, eye, view, width, height, kept, nearest)
    n = 0
    looks = 0
    wide, high = float(width), float(height)
    for place in range(count):
        if looks < len(LOOK_BACK) and place >= LOOK_BACK[looks] * count:
            _look_back(depth, blocks, groups, tiles, blocks)
            looks += 1
        k = kept[place]
        if looks > 0 and _cluster_hidden(spheres[k], rot, eye, view, tiles, blocks, per_tile):
            continue
        for f in range(np.uint32(clusters[k, 0]), np.uint32(clusters[k, 1])):
            facing = planes[f, 0] * ex + planes[f, 1] * ey + planes[f, 2] * ez - planes[f, 3]
            if facing <= 0.0 and planes[f, 4] == 0.0:
                continue
            inside = 0
            for c in range(3):
                dx, dy, dz = corners[f, 3 * c] - ex, corners[f, 3 * c + 1] - ey, corners[f, 3 * c + 2] - ez
                px[c] = r00 * dx + r01 * dy + r02 * dz
                py[c] = r10 * dx + r11 * dy + r12 * dz
                pz[c] = r20 * dx + r21 * dy + r22 * dz
                inside += pz[c] >= near
            if inside == 0:
                continue
            pieces = 1
            if inside == 3:
                for c in range(3):
                    w = 1.0 / pz[c]
                    shape[0, 3 * c], shape[0, 3 * c + 1] = cx + fx * px[c] * w, cy + fy * py[c] * w
                    shape[0, 3 * c + 2] = w
            else:
                pieces = _clip(px, py, pz, near, fx, fy, cx, cy, shape)
            for piece in range(pieces):
                n = _fill(shape, piece, f, n, wide, high, samples, offsets, blocks, groups, tiles, blocks, looks > 0,
                          depth, ids, plane)  # fmt: skip
    return n


@jit(nogil=True)
def _clip(px, py, pz, near, fx, fy, cx, cy, shape):
    """Cut a triangle at the near plane → 1 or 2 projected triangles in ``shape``; their number."""
    w_near = 1.0 / near
    corner = np.empty((4, 3))
    count = 0
    for c in range(3):
        d = (c + 1) % 3
        if pz[c] >= near:
            w = 1.0 / pz[c]
            corner[count, 0], corner[count, 1], corner[count, 2] = cx + fx * px[c] * w, cy + fy * py[c] * w, w
            count += 1
        if (pz[c] >= near) != (pz[d] >= near):
            # always from the end in front to the end behind: neighbours cut the same point
            i, o = (c, d) if pz[c] >= near else (d, c)
            s = (pz[i] - near) / (pz[i] - pz[o])
            corner[count, 0] = cx + fx * (px[i] + s * (px[o] - px[i])) * w_near
            corner[count, 1] = cy + fy * (py[i] + s * (py[o] - py[i])) * w_near
            corner[count, 2] = w_near
            count += 1
    for piece in range(count - 2):
        for c in range(3):
            source = 0 if c == 0 else piece + c
            for v in range(3):
                shape[piece, 3 * c + v] = corner[source, v]
    return count - 2
