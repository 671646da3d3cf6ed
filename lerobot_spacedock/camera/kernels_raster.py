"""Visibility: cull, project and clip triangles, then scan-convert them into a band of rows.

Depth is kept as 1/z (metres⁻¹), which is affine in the image plane and larger when nearer. Edges run from their upper
to their lower end in double precision, so two triangles that share an edge agree on every sample bit for bit. No
fast-math and no libm: the same input gives the same bytes on every x86-64 CPU.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

BAND_ROWS = 8  # 8 rows x 640 columns x 4 samples x 8 bytes stay in a core's second-level cache
SAMPLE_X_4 = (0.375, 0.875, 0.125, 0.625)  # rotated grid: sample rows are 1/4 pixel apart, columns all differ


@jit(nogil=True)
def _emit(ax, ay, aw, bx, by, bw, cx, cy, cw, width, height, grain, xy, plane, n):
    """Store one projected triangle, its corners sorted by row; → number stored so far."""
    if ay > by:
        ax, ay, aw, bx, by, bw = bx, by, bw, ax, ay, aw
    if by > cy:
        bx, by, bw, cx, cy, cw = cx, cy, cw, bx, by, bw
    if ay > by:
        ax, ay, aw, bx, by, bw = bx, by, bw, ax, ay, aw
    if cy <= 0.0 or ay >= height or max(ax, bx, cx) <= 0.0 or min(ax, bx, cx) >= width:
        return n
    # samples stand on a lattice of ``grain`` a pixel: a speck that holds no row or column of it leaves no trace
    if math.ceil(ay * grain - 0.5) == math.ceil(cy * grain - 0.5):
        return n
    if math.ceil(min(ax, bx, cx) * grain - 0.5) == math.ceil(max(ax, bx, cx) * grain - 0.5):
        return n
    det = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if not abs(det) > 1e-9:
        return n
    gx = ((bw - aw) * (cy - ay) - (cw - aw) * (by - ay)) / det
    gy = ((cw - aw) * (bx - ax) - (bw - aw) * (cx - ax)) / det
    xy[n, 0], xy[n, 1], xy[n, 2], xy[n, 3], xy[n, 4], xy[n, 5] = ax, ay, bx, by, cx, cy
    plane[n, 0], plane[n, 1], plane[n, 2] = gx, gy, aw - gx * ax - gy * ay
    return n + 1


@jit(nogil=True)
def project(corners, planes, clusters, spheres, rot, eye, view, width, height, samples, xy, plane):
    """Cull by cluster and by face, transform, clip at the near plane and project.

    Args:
        corners: (F, 9) float32 m; three corners of each triangle.
        planes: (F, 5) float32; outward unit normal, offset (n·p), and 1 where both sides are seen.
        clusters: (K, 2) int32; first triangle and one past the last.
        spheres: (K, 4) float32; centre and radius, m.
        rot: (3, 3) float64; rows are the camera's right, down and forward axes.
        eye: (3,) float64 m.
        view: (5,) float64; fx, fy, cx, cy in pixels and the near distance in metres.
        samples: samples a pixel, 1 or 4.
        xy, plane: outputs, (2F, 6) and (2F, 4) float64: corners by row; 1/z as an affine function, triangle number.

    Returns:
        The number of projected triangles.
    """
    grain = 4.0 if samples == 4 else 1.0
    fx, fy, cx, cy, near = view[0], view[1], view[2], view[3], view[4]
    n = 0
    left, right = cx / fx, (width - cx) / fx
    top, bottom = cy / fy, (height - cy) / fy
    norm_l, norm_r = math.sqrt(1.0 + left * left), math.sqrt(1.0 + right * right)
    norm_t, norm_b = math.sqrt(1.0 + top * top), math.sqrt(1.0 + bottom * bottom)
    px, py, pz = np.empty(3), np.empty(3), np.empty(3)
    for k in range(clusters.shape[0]):
        dx = float(spheres[k, 0]) - eye[0]
        dy = float(spheres[k, 1]) - eye[1]
        dz = float(spheres[k, 2]) - eye[2]
        radius = float(spheres[k, 3])
        x = rot[0, 0] * dx + rot[0, 1] * dy + rot[0, 2] * dz
        y = rot[1, 0] * dx + rot[1, 1] * dy + rot[1, 2] * dz
        z = rot[2, 0] * dx + rot[2, 1] * dy + rot[2, 2] * dz
        if (
            z < near - radius
            or -x - left * z > radius * norm_l
            or x - right * z > radius * norm_r
            or -y - top * z > radius * norm_t
            or y - bottom * z > radius * norm_b
        ):
            continue
        for f in range(clusters[k, 0], clusters[k, 1]):
            facing = planes[f, 0] * eye[0] + planes[f, 1] * eye[1] + planes[f, 2] * eye[2] - planes[f, 3]
            if facing <= 0.0 and planes[f, 4] == 0.0:
                continue
            inside = 0
            for c in range(3):
                dx = float(corners[f, 3 * c]) - eye[0]
                dy = float(corners[f, 3 * c + 1]) - eye[1]
                dz = float(corners[f, 3 * c + 2]) - eye[2]
                px[c] = rot[0, 0] * dx + rot[0, 1] * dy + rot[0, 2] * dz
                py[c] = rot[1, 0] * dx + rot[1, 1] * dy + rot[1, 2] * dz
                pz[c] = rot[2, 0] * dx + rot[2, 1] * dy + rot[2, 2] * dz
                if pz[c] >= near:
                    inside += 1
            if inside == 0:
                continue
            first = n
            if inside == 3:
                wa, wb, wc = 1.0 / pz[0], 1.0 / pz[1], 1.0 / pz[2]
                n = _emit(
                    cx + fx * px[0] * wa, cy + fy * py[0] * wa, wa,
                    cx + fx * px[1] * wb, cy + fy * py[1] * wb, wb,
                    cx + fx * px[2] * wc, cy + fy * py[2] * wc, wc,
                    width, height, grain, xy, plane, n,
                )  # fmt: skip
            else:
                count = 0
                x0 = y0 = x1 = y1 = x2 = y2 = x3 = y3 = w0 = w1 = w2 = w3 = 0.0
                for c in range(3):
                    d = (c + 1) % 3
                    for part in range(2):
                        if part == 0:
                            if pz[c] < near:
                                continue
                            w = 1.0 / pz[c]
                            sx, sy = cx + fx * px[c] * w, cy + fy * py[c] * w
                        else:
                            if (pz[c] >= near) == (pz[d] >= near):
                                continue
                            # always from the end in front to the end behind: neighbours cut the same point
                            i, o = (c, d) if pz[c] >= near else (d, c)
                            s = (pz[i] - near) / (pz[i] - pz[o])
                            w = 1.0 / near
                            sx = cx + fx * (px[i] + s * (px[o] - px[i])) * w
                            sy = cy + fy * (py[i] + s * (py[o] - py[i])) * w
                        if count == 0:
                            x0, y0, w0 = sx, sy, w
                        elif count == 1:
                            x1, y1, w1 = sx, sy, w
                        elif count == 2:
                            x2, y2, w2 = sx, sy, w
                        else:
                            x3, y3, w3 = sx, sy, w
                        count += 1
                n = _emit(x0, y0, w0, x1, y1, w1, x2, y2, w2, width, height, grain, xy, plane, n)
                if count == 4:
                    n = _emit(x0, y0, w0, x2, y2, w2, x3, y3, w3, width, height, grain, xy, plane, n)
            for m in range(first, n):
                plane[m, 3] = f
    return n


@jit(nogil=True)
def bin_bands(xy, n, height, rows):
    """Triangles sorted by the bands of rows that they touch → (start of each band (B + 1,), indices)."""
    bands = (height + rows - 1) // rows
    start = np.zeros(bands + 1, np.int64)
    for t in range(n):
        b0 = int(max(xy[t, 1], 0.0)) // rows
        b1 = min(int(min(xy[t, 5], float(height))) // rows, bands - 1)
        for b in range(b0, b1 + 1):
            start[b + 1] += 1
    for b in range(bands):
        start[b + 1] += start[b]
    items = np.empty(start[bands], np.int32)
    fill = start[:-1].copy()
    for t in range(n):
        b0 = int(max(xy[t, 1], 0.0)) // rows
        b1 = min(int(min(xy[t, 5], float(height))) // rows, bands - 1)
        for b in range(b0, b1 + 1):
            items[fill[b]] = t
            fill[b] += 1
    return start, items


@jit(nogil=True)
def scan(xy, plane, items, i0, i1, row0, row1, width, samples, offsets, ramp, depth, ids):
    """Scan-convert ``items[i0:i1]`` into sample rows ``samples*row0 .. samples*row1``.

    Sample row k lies at y = (k + ½)/samples; its samples at x = column + offsets[k % samples].
    ``ramp`` holds 0, 1, 2 ... as float32, ``width`` of them.
    ``depth`` and ``ids`` are flat, one run of ``width`` per sample row; ids get the projected triangle's number.
    """
    scale = float(samples)
    first_row, last_row = samples * row0, samples * row1
    wide = float(width)
    for item in range(i0, i1):
        t = items[item]
        ax, ay, bx, by, cx, cy = xy[t, 0], xy[t, 1], xy[t, 2], xy[t, 3], xy[t, 4], xy[t, 5]
        k0 = max(math.ceil(max(ay * scale - 0.5, -1.0)), first_row)
        k1 = min(math.ceil(min(cy * scale - 0.5, scale * 16384.0)), last_row)
        if k0 >= k1:
            continue
        slope_ac = (cx - ax) / (cy - ay)
        slope_ab = (bx - ax) / (by - ay) if by > ay else 0.0
        slope_bc = (cx - bx) / (cy - by) if cy > by else 0.0
        gx, gy, g0 = plane[t, 0], plane[t, 1], plane[t, 2]
        step = np.float32(gx)
        for k in range(k0, k1):
            y = (k + 0.5) / scale
            x0 = ax + (y - ay) * slope_ac
            x1 = ax + (y - ay) * slope_ab if y < by else bx + (y - by) * slope_bc
            if x0 > x1:
                x0, x1 = x1, x0
            off = offsets[k % samples]
            j0 = math.ceil(min(max(x0 - off, 0.0), wide))
            j1 = math.ceil(min(max(x1 - off, 0.0), wide))
            if j0 >= j1:
                continue
            base = np.uint64((k - first_row) * width + j0)  # unsigned: no wrap-around test on each index
            w0 = np.float32(gx * (j0 + off) + gy * y + g0)
            for j in range(np.uint64(j1 - j0)):
                # selects, not branches, and a ramp read from memory: this loop becomes vector code
                w = w0 + step * ramp[j]
                old = depth[base + j]
                before = ids[base + j]
                nearer = w > old
                keep = np.float32(nearer)  # arithmetic, because a masked store is slow on some CPUs
                depth[base + j] = keep * w + (np.float32(1.0) - keep) * old
                ids[base + j] = t if nearer else before
