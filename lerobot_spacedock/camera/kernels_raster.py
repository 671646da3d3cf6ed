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

from lerobot_spacedock.jit import inner, jit

from .kernels_simd import CELL, CELL_SAMPLES, TILE_CELLS, cell_place, farthest, fill_cells

SAMPLE_X_4 = (0.375, 0.875, 0.125, 0.625)  # rotated grid: sample rows are 1/4 pixel apart, columns all differ
LOOK_BACK = (0.04, 0.1, 0.2, 0.4)  # shares of the clusters after which the tiles' farthest depths are found anew
ROUNDING = 1.00001  # samples are affine in float32: room that they are left before something counts as hidden
CLUSTER_TRIANGLES = 64
LANES = CLUSTER_TRIANGLES + 8  # numbers between the rows of a cluster's scratch arrays

# rows of those arrays: corners from the upper to the lower one, in pixels and 1/m; then 1/z as an affine function of
# column and row; then dx/dy of the upper-lower, upper-middle and middle-lower edges; whether it may hold a sample
AX, AY, AW, BX, BY, BW, CX, CY, CW, GX, GY, G0, LONG, UPPER, LOWER, HOLDS = range(16)


@inner
def order_clusters(spheres, cones, rot, eye, view, width, height, finest, kept, near):
    """Clusters that may be in the picture, nearest first → their number; ``near`` gets each one's nearest depth, m."""
    fx, fy, cx, cy, clip = view[0], view[1], view[2], view[3], view[4]
    left, right = cx / fx, (width - cx) / fx
    top, bottom = cy / fy, (height - cy) / fy
    norm_l, norm_r = math.sqrt(1.0 + left * left), math.sqrt(1.0 + right * right)
    norm_t, norm_b = math.sqrt(1.0 + top * top), math.sqrt(1.0 + bottom * bottom)
    n = np.int64(0)
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
        if spheres[k, 4] * fy < finest * (z - radius):
            continue  # too fine to be seen
        kept[n], near[n] = k, z - radius
        n += 1
    _sort(n, near, kept)
    return n


@inner
def _sort(n, near, kept):
    """Sort the first ``n`` of both by ``near`` (shell sort: np.argsort takes much longer to compile)."""
    gap = 1
    while gap < n:
        gap = 3 * gap + 1
    while gap > 1:
        gap //= 3
        for i in range(gap, n):
            distance, cluster, j = near[i], kept[i], i
            while j >= gap and near[j - gap] > distance:
                near[j], kept[j] = near[j - gap], kept[j - gap]
                j -= gap
            near[j], kept[j] = distance, cluster


@inner
def _look_back(cells, blocks, groups, floors):
    """Find the farthest depth of each tile."""
    for tile in range(floors.shape[0]):
        if floors[tile] < np.float32(0.0):
            continue
        left = groups - TILE_CELLS * (tile // blocks)
        floors[tile] = farthest(cells, tile * TILE_CELLS * CELL, min(TILE_CELLS, left))


@inner(forceinline=True)
def _hidden(floors, across, x0, x1, y0, y1, per_tile, w):
    """Whether something at 1/z ≤ w within the given pixels lies behind all that is drawn there."""
    down = floors.shape[0] // across
    i0, i1 = int(min(max(y0, 0.0) / per_tile, down - 1.0)), int(min(max(y1, 0.0) / per_tile, down - 1.0))
    j0, j1 = int(min(max(x0, 0.0), across * 8.0 - 1.0)) >> 3, int(min(max(x1, 0.0), across * 8.0 - 1.0)) >> 3
    far = np.float32(w * ROUNDING)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if floors[i * across + j] < far:
                return False
    return True


@inner
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


@jit(nogil=True)
def draw_triangles(corners, planes, surface, clusters, spheres, cones, rot, eye, view, width, height, samples, finest,
                   cells, away, floors):  # fmt: skip
    """Cull by cluster, face and what is already drawn; transform, clip at the near plane, project and fill.

    Args:
        corners: (9, F) float32 m; three corners of each triangle.
        planes: (5, F) float32; outward unit normal, offset (n·p), and 1 where both sides are seen.
        surface: (F,) int32; the surface that each belongs to.
        clusters: (K, 2) int32; first triangle and one past the last.
        spheres: (K, 5) float32; centre, radius and width of the widest part, m.
        cones: (K, 4) float32; axis of a cone that holds the normals and the sine of its half angle, or 2.
        rot: (3, 3) float64; rows are the camera's right, down and forward axes.
        eye: (3,) float64 m.
        view: (5,) float64; fx, fy, cx, cy in pixels and the near distance in metres.
        samples: samples a pixel, 1 or 4.
        finest: pixels; clusters whose parts all look narrower than this are left out.
        cells: output, int32, the samples (``kernels_simd``): 1/z and number of the surface drawn, or -1.
        away: output, (S,) float32 m: how far behind the camera each drawn surface's plane is, along its normal.
        floors: room for a float32 a tile.
    """
    blocks = (width + 7) >> 3
    groups = (height * samples + 3) >> 2
    tiles = floors[: blocks * ((groups + TILE_CELLS - 1) // TILE_CELLS)]
    tiles[:] = np.float32(-1.0)
    per_tile = 4.0 * TILE_CELLS / samples
    kept, nearest = np.empty(len(clusters), np.int64), np.empty(len(clusters))
    count = order_clusters(spheres, cones, rot, eye, view, width, height, finest, kept, nearest)
    flat, keep = np.empty(9 * LANES, np.float32), np.empty(LANES, np.int32)
    chosen = np.empty(2 * LANES, np.uint64)
    shapes, number = np.empty(16 * 2 * LANES), np.empty(2 * LANES, np.int32)
    looks = 0
    for place in range(count):
        if looks < len(LOOK_BACK) and place >= LOOK_BACK[looks] * count:
            _look_back(cells, blocks, groups, tiles)
            looks += 1
        k = kept[place]
        if looks > 0 and _cluster_hidden(spheres[k], rot, eye, view, tiles, blocks, per_tile):
            continue
        first, end = clusters[k, 0], clusters[k, 1]
        _project(corners, planes, first, end, rot, eye, view, width, height, samples, flat, keep)
        n = _choose(corners, planes, surface, first, end, rot, eye, view, flat, keep, chosen, shapes, number, away)
        _set_up(n, samples, shapes)
        _fill(n, shapes, number, chosen, width, height, samples, blocks, tiles, cells)
    for tile in range(tiles.shape[0]):
        if tiles[tile] < np.float32(0.0):
            for cell in range(tile * TILE_CELLS, (tile + 1) * TILE_CELLS):
                cells[cell * CELL + CELL_SAMPLES : cell * CELL + CELL] = -1


@inner
def _project(corners, planes, first, end, rot, eye, view, width, height, samples, flat, keep):
    """Project a cluster's triangles, eight at a time.

    ``flat`` gets their corners, the uppermost first. ``keep`` is 0 for those that leave no trace (turned away, off the
    picture, or between the rows or the columns of the lattice that the samples stand on), 1 for those wholly in front
    of the near plane and 2 for those that it cuts.
    """
    f32 = np.float32
    ex, ey, ez = f32(eye[0]), f32(eye[1]), f32(eye[2])
    r00, r01, r02 = f32(rot[0, 0]), f32(rot[0, 1]), f32(rot[0, 2])
    r10, r11, r12 = f32(rot[1, 0]), f32(rot[1, 1]), f32(rot[1, 2])
    r20, r21, r22 = f32(rot[2, 0]), f32(rot[2, 1]), f32(rot[2, 2])
    fx, fy, cx, cy, near = f32(view[0]), f32(view[1]), f32(view[2]), f32(view[3]), f32(view[4])
    grain, half, one, zero = f32(samples), f32(0.5), f32(1.0), f32(0.0)
    wide, high = f32(width), f32(height)
    x0s, y0s, z0s = corners[0, first:end], corners[1, first:end], corners[2, first:end]
    x1s, y1s, z1s = corners[3, first:end], corners[4, first:end], corners[5, first:end]
    x2s, y2s, z2s = corners[6, first:end], corners[7, first:end], corners[8, first:end]
    nx, ny, nz, offset = planes[0, first:end], planes[1, first:end], planes[2, first:end], planes[3, first:end]
    both = planes[4, first:end]
    for k in range(np.uint64(end - first)):
        x, y, z = x0s[k] - ex, y0s[k] - ey, z0s[k] - ez
        az = r20 * x + r21 * y + r22 * z
        aw = one / az
        ax, ay = cx + fx * (r00 * x + r01 * y + r02 * z) * aw, cy + fy * (r10 * x + r11 * y + r12 * z) * aw
        x, y, z = x1s[k] - ex, y1s[k] - ey, z1s[k] - ez
        bz = r20 * x + r21 * y + r22 * z
        bw = one / bz
        bx, by = cx + fx * (r00 * x + r01 * y + r02 * z) * bw, cy + fy * (r10 * x + r11 * y + r12 * z) * bw
        x, y, z = x2s[k] - ex, y2s[k] - ey, z2s[k] - ez
        cz = r20 * x + r21 * y + r22 * z
        cw = one / cz
        gx, gy = cx + fx * (r00 * x + r01 * y + r02 * z) * cw, cy + fy * (r10 * x + r11 * y + r12 * z) * cw
        faces = (nx[k] * ex + ny[k] * ey + nz[k] * ez > offset[k]) | (both[k] > zero)
        front = (az >= near) & (bz >= near) & (cz >= near)
        behind = (az < near) & (bz < near) & (cz < near)
        left, right = min(ax, bx, gx), max(ax, bx, gx)
        top, bottom = min(ay, by, gy), max(ay, by, gy)
        traces = (bottom > zero) & (top < high) & (right > zero) & (left < wide)
        traces &= np.ceil(left * grain - half) < np.ceil(right * grain - half)
        traces &= np.ceil(top * grain - half) < np.ceil(bottom * grain - half)
        keep[k] = np.int32(faces & front & traces) + np.int32(2) * np.int32(faces & (not front) & (not behind))
        swap = ay > by
        ax, bx, aw, bw, ay, by = (
            bx if swap else ax, ax if swap else bx, bw if swap else aw, aw if swap else bw, by if swap else ay,
            ay if swap else by)  # fmt: skip
        swap = by > gy
        bx, gx, bw, cw, by, gy = (
            gx if swap else bx, bx if swap else gx, cw if swap else bw, bw if swap else cw, gy if swap else by,
            by if swap else gy)  # fmt: skip
        swap = ay > by
        ax, bx, aw, bw, ay, by = (
            bx if swap else ax, ax if swap else bx, bw if swap else aw, aw if swap else bw, by if swap else ay,
            ay if swap else by)  # fmt: skip
        flat[AX * LANES + k], flat[AY * LANES + k], flat[AW * LANES + k] = ax, ay, aw
        flat[BX * LANES + k], flat[BY * LANES + k], flat[BW * LANES + k] = bx, by, bw
        flat[CX * LANES + k], flat[CY * LANES + k], flat[CW * LANES + k] = gx, gy, cw


@inner
def _choose(corners, planes, surface, first, end, rot, eye, view, flat, keep, chosen, shapes, number, away):
    """Bring the triangles that leave a trace together in ``shapes``, their surfaces in ``number``; → their number."""
    n = cuts = np.int64(0)  # a literal 0 would have _clip compiled twice
    for k in range(np.uint64(end - first)):  # without a branch: what is kept follows no rule
        chosen[n] = k
        n += keep[k] & 1
        cuts += keep[k] >> 1
    for row in range(np.uint64(9)):
        for i in range(np.uint64(n)):
            shapes[row * np.uint64(2 * LANES) + i] = flat[row * np.uint64(LANES) + chosen[i]]
    for i in range(np.uint64(n)):
        f = np.uint64(first) + chosen[i]
        number[i] = surface[f]
        away[np.uint32(surface[f])] = _behind(planes, f, eye)
    for k in range(np.uint64(end - first if cuts > 0 else 0)):
        if keep[k] == 2:
            f = np.uint64(first) + k
            away[surface[f]] = _behind(planes, f, eye)
            for _ in range(_clip(corners, f, rot, eye, view, shapes, n)):
                number[n] = surface[f]
                n += 1
    return n


@inner(forceinline=True)
def _behind(planes, f, eye):
    """How far the camera is behind a triangle's plane."""
    return planes[3, f] - (planes[0, f] * eye[0] + planes[1, f] * eye[1] + planes[2, f] * eye[2])


@inner
def _set_up(n, samples, shapes):
    """Slopes of ``n`` triangles' edges and depths; which of them hold a sample, where they have four rows at most."""
    row = 2 * LANES
    grain, step = float(samples), 1.0 / samples
    base, odd, late = (0.375, 0.5, -0.25) if samples == 4 else (0.5, 0.0, 0.0)
    for k in range(np.uint64(n)):
        ax, ay, aw = shapes[AX * row + k], shapes[AY * row + k], shapes[AW * row + k]
        bx, by, bw = shapes[BX * row + k], shapes[BY * row + k], shapes[BW * row + k]
        cx, cy, cw = shapes[CX * row + k], shapes[CY * row + k], shapes[CW * row + k]
        det = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        inv = 1.0 / det if abs(det) > 1e-9 else 0.0
        gx = ((bw - aw) * (cy - ay) - (cw - aw) * (by - ay)) * inv
        gy = ((cw - aw) * (bx - ax) - (bw - aw) * (cx - ax)) * inv
        shapes[GX * row + k], shapes[GY * row + k], shapes[G0 * row + k] = gx, gy, aw - gx * ax - gy * ay
        long = (cx - ax) / (cy - ay) if cy > ay else 0.0
        upper = (bx - ax) / (by - ay) if by > ay else 0.0
        lower = (cx - bx) / (cy - by) if cy > by else 0.0
        shapes[LONG * row + k], shapes[UPPER * row + k], shapes[LOWER * row + k] = long, upper, lower
        top = np.ceil(ay * grain - 0.5)
        rows = np.ceil(cy * grain - 0.5) - top
        holds = rows > 4.0
        for r in range(4):
            y = (top + r + 0.5) * step
            x0 = ax + (y - ay) * long
            x1 = ax + (y - ay) * upper if y < by else bx + (y - by) * lower
            # where in its column the row's samples stand, see SAMPLE_X_4
            two = np.floor((top + r) * 0.5)
            off = base + odd * (top + r - 2.0 * two) + late * (two - 2.0 * np.floor(two * 0.5))
            holds |= (rows > r) & (np.ceil(min(x0, x1) - off) < np.ceil(max(x0, x1) - off))
        shapes[HOLDS * row + k] = 1.0 if holds else 0.0


@inner
def _fill(n, shapes, number, chosen, width, height, samples, blocks, floors, cells):
    """Scan-convert ``n`` triangles, but for tiles that hold nothing farther than they are."""
    row = 2 * LANES
    grain, wide = float(samples), float(width)
    step = 1.0 / grain
    offsets = (0.375, 0.875, 0.125, 0.625) if samples == 4 else (0.5, 0.5, 0.5, 0.5)
    m = 0
    for k in range(np.uint64(n)):
        chosen[m] = k
        m += np.int64(shapes[HOLDS * row + k])
    for i in range(np.uint64(m)):
        k = chosen[i]
        ax, ay, bx, by = shapes[AX * row + k], shapes[AY * row + k], shapes[BX * row + k], shapes[BY * row + k]
        cx, cy = shapes[CX * row + k], shapes[CY * row + k]
        begin = np.int64(max(math.ceil(ay * grain - 0.5), 0.0))
        end = np.int64(min(math.ceil(cy * grain - 0.5), height * grain))
        if begin >= end:
            continue
        w = max(shapes[AW * row + k], shapes[BW * row + k], shapes[CW * row + k])
        if _hidden(floors, blocks, min(ax, bx, cx), max(ax, bx, cx), ay, cy, 4.0 * TILE_CELLS / grain, w):
            continue
        nearest = np.float32(w * ROUNDING)
        corner = (ax, ay, bx, by, cy)
        slopes = (shapes[LONG * row + k], shapes[UPPER * row + k], shapes[LOWER * row + k])
        plane = (shapes[GX * row + k], shapes[GY * row + k], shapes[G0 * row + k])
        for g in range(begin >> 2, (end + 3) >> 2):
            fill_cells(cells, floors, cell_place(g, 0, blocks), (g >> 3) * blocks, wide, corner, slopes, plane, nearest,
                       (4 * g + 0.5) * step, step, offsets, number[k])  # fmt: skip


@inner(allocates=True)
def _clip(corners, f, rot, eye, view, shapes, n):
    """Cut a triangle at the near plane → 1 or 2 projected triangles after the ``n`` in ``shapes``; their number.

    Corners in front of the plane land on the same bits as in ``_project``, so that no neighbour parts from this one.
    """
    f32 = np.float32
    fx, fy, cx, cy, near = f32(view[0]), f32(view[1]), f32(view[2]), f32(view[3]), f32(view[4])
    px, py, pz = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    for c in range(3):
        x, y = corners[3 * c, f] - f32(eye[0]), corners[3 * c + 1, f] - f32(eye[1])
        z = corners[3 * c + 2, f] - f32(eye[2])
        px[c] = f32(rot[0, 0]) * x + f32(rot[0, 1]) * y + f32(rot[0, 2]) * z
        py[c] = f32(rot[1, 0]) * x + f32(rot[1, 1]) * y + f32(rot[1, 2]) * z
        pz[c] = f32(rot[2, 0]) * x + f32(rot[2, 1]) * y + f32(rot[2, 2]) * z
    corner = np.empty((4, 3))
    count = 0
    for c in range(3):
        d = (c + 1) % 3
        if pz[c] >= near:
            w = f32(1.0) / pz[c]
            corner[count, 0], corner[count, 1], corner[count, 2] = cx + fx * px[c] * w, cy + fy * py[c] * w, w
            count += 1
        if (pz[c] >= near) != (pz[d] >= near):
            # always from the end in front to the end behind: neighbours cut the same point
            i, o = (c, d) if pz[c] >= near else (d, c)
            s = (float(pz[i]) - near) / (float(pz[i]) - pz[o])
            corner[count, 0] = cx + fx * (px[i] + s * (px[o] - px[i])) / near
            corner[count, 1] = cy + fy * (py[i] + s * (py[o] - py[i])) / near
            corner[count, 2] = 1.0 / near
            count += 1
    for piece in range(count - 2):
        a, b, c = 0, piece + 1, piece + 2
        if corner[a, 1] > corner[b, 1]:
            a, b = b, a
        if corner[b, 1] > corner[c, 1]:
            b, c = c, b
        if corner[a, 1] > corner[b, 1]:
            a, b = b, a
        for v in range(3):
            shapes[(AX + v) * 2 * LANES + n + piece] = corner[a, v]
            shapes[(BX + v) * 2 * LANES + n + piece] = corner[b, v]
            shapes[(CX + v) * 2 * LANES + n + piece] = corner[c, v]
    return count - 2
