"""From samples to fragments: what each row of pixels shows, and where on the station it is.

A run is a stretch of pixels in a row that show one triangle at all their samples, or one triangle's share of a single
pixel. Normal, texture place and openness are affine in position over a triangle, so a run needs the triangle's numbers
once and eight of its pixels are located at a time.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

from .kernels_simd import CELL, columns_of, pure_columns

CHUNK = 256  # fragments that are shaded together: the scratch array then stays in the first-level cache
STRIDE = CHUNK + 8  # runs are written in eights, the last of them over its end

# rows of the scratch array
(NX, NY, NZ, VX, VY, VZ, AR, AG, AB, SR, SG, SB, ROUGH, F0, METAL, AO, SUN, EMIT, DIST, TU, TV, FOOT, UX, UY, UZ, WX,
 WY, WZ, BUMP, TINT, PATTERN, FU, FV, HIGH, TEXEL, SPAN, PIXEL, WEIGHT) = range(38)  # fmt: skip
SCRATCH_ROWS = 38

# columns of the triangle table: normal, u, v and openness are each affine in position; material; two-sided flag
T_N, T_U, T_V, T_AO, T_KIND, T_BOTH = 0, 12, 16, 20, 24, 25
TRIANGLE_SIZE = 32  # two whole cache lines

# columns of the material table
M_BASE, M_SECOND, M_ROUGH, M_F0, M_METAL, M_SCALE, M_BUMP, M_PATTERN, M_EMIT, M_TINT = 0, 3, 6, 7, 8, 9, 10, 11, 12, 13

TILE = 256  # texels along a pattern's side; then its mip levels, the level of side s at place s²
LEVELS = 9
PATTERN_TEXELS = 2 * TILE * TILE


@jit(nogil=True)
def collect(ids, row, width, samples, off_x, pixel0, n, run_triangle, run_pixel, run_length, run_x, run_y, run_weight,
            sky):  # fmt: skip
    """List the runs of one row of pixels after the ``n`` that are there; → their number.

    ``sky`` gets the share of each pixel where nothing was hit, from place ``pixel0`` on. A run of several pixels starts
    at its first pixel's centre; a share of one pixel stands at the centroid of its samples.
    """
    blocks = (width + 7) >> 3
    step = 8 if samples == 4 else 0
    base = row * blocks * CELL if samples == 4 else (row >> 2) * blocks * CELL + 8 * (row & 3)
    middle = np.float32(row + 0.5)
    current, length, begin = -1, 0, 0
    for block in range(blocks):
        place = base + block * CELL
        column = 8 * block
        if column + 8 <= width and length > 0 and columns_of(ids, place, step, current) == 255:
            length += 8
            continue
        pure = pure_columns(ids, place, step)
        for j in range(min(8, width - column)):
            t = ids[np.uint64(place + j)]
            if (pure >> j) & 1:
                if t == current and length > 0:
                    length += 1
                    continue
                if length > 0:
                    n = _end_run(current, pixel0 + begin, length, begin, middle, n, run_triangle, run_pixel, run_length,
                                 run_x, run_y, run_weight, sky)  # fmt: skip
                current, length, begin = t, 1, column + j
                continue
            if length > 0:
                n = _end_run(current, pixel0 + begin, length, begin, middle, n, run_triangle, run_pixel, run_length,
                             run_x, run_y, run_weight, sky)  # fmt: skip
                length = 0
            empty = 0
            for s in range(4):
                t = ids[np.uint64(place + j + 8 * s)]
                if t < 0:
                    empty += 1
                    continue
                seen = False
                for r in range(s):
                    seen |= ids[np.uint64(place + j + 8 * r)] == t
                if seen:
                    continue
                count = 0
                x = y = np.float32(0.0)
                for r in range(s, 4):
                    if ids[np.uint64(place + j + 8 * r)] == t:
                        count += 1
                        x += np.float32(off_x[r])
                        y += np.float32(0.25 * r + 0.125)
                share = np.float32(1.0) / np.float32(count)
                run_triangle[n], run_pixel[n], run_length[n] = t, pixel0 + column + j, 1
                run_x[n], run_y[n] = np.float32(column + j) + x * share, np.float32(row) + y * share
                run_weight[n] = np.float32(0.25) * np.float32(count)
                n += 1
            sky[pixel0 + column + j] = np.float32(0.25) * np.float32(empty)
    if length > 0:
        n = _end_run(current, pixel0 + begin, length, begin, middle, n, run_triangle, run_pixel, run_length, run_x,
                     run_y, run_weight, sky)  # fmt: skip
    return n


@jit(nogil=True, forceinline=True)
def _end_run(triangle, pixel, length, column, y, n, run_triangle, run_pixel, run_length, run_x, run_y, run_weight, sky):
    sky[pixel : pixel + length] = np.float32(1.0 if triangle < 0 else 0.0)
    if triangle < 0:
        return n
    run_triangle[n], run_pixel[n], run_length[n] = triangle, pixel, length
    run_x[n], run_y[n], run_weight[n] = np.float32(column) + np.float32(0.5), y, np.float32(1.0)
    return n + 1


@jit(nogil=True)
def locate(run, done, runs, run_triangle, run_pixel, run_length, run_x, run_y, run_weight, plane, table, materials,
           map_affine, map_size, map_start, map_reach, light, rot, eye, view, s):  # fmt: skip
    """Fill the scratch array with fragments, from pixel ``done`` of run ``run`` on → (run, done, fragments)."""
    f32 = np.float32
    ex, ey, ez = f32(eye[0]), f32(eye[1]), f32(eye[2])
    inv_fx, inv_fy = f32(1.0 / view[0]), f32(1.0 / view[1])
    cx, cy = f32(view[2]), f32(view[3])
    r00, r01, r02 = f32(rot[0, 0]), f32(rot[0, 1]), f32(rot[0, 2])
    r10, r11, r12 = f32(rot[1, 0]), f32(rot[1, 1]), f32(rot[1, 2])
    r20, r21, r22 = f32(rot[2, 0]), f32(rot[2, 1]), f32(rot[2, 2])
    one, zero = f32(1.0), f32(0.0)
    sx, sy, sz = light[0], light[1], light[2]
    shadows = map_size.shape[0] > 0
    tight, middle = map_reach[0], map_reach[1]
    grain = inv_fx * f32(TILE)
    n = 0
    while run < runs and n < CHUNK:
        t = np.uint32(run_triangle[run])
        gx, w_run = plane[t, 0], plane[t, 1] * run_y[run] + plane[t, 2]
        f = np.uint32(plane[t, 3])
        n0, n1, n2 = table[f, 0], table[f, 1], table[f, 2]
        n00, n01, n02 = table[f, 3], table[f, 4], table[f, 5]
        n10, n11, n12 = table[f, 6], table[f, 7], table[f, 8]
        n20, n21, n22 = table[f, 9], table[f, 10], table[f, 11]
        m = np.uint32(table[f, 24])
        scale = materials[m, 9]
        gu, gux, guy, guz = table[f, 12] * scale, table[f, 13], table[f, 14], table[f, 15]
        gv, gvx, gvy, gvz = table[f, 16] * scale, table[f, 17], table[f, 18], table[f, 19]
        sux, suy, suz, svx, svy, svz = gux * scale, guy * scale, guz * scale, gvx * scale, gvy * scale, gvz * scale
        ga, gax, gay, gaz = table[f, 20], table[f, 21], table[f, 22], table[f, 23]
        both = table[f, 25]
        base_r, base_g, base_b = materials[m, 0], materials[m, 1], materials[m, 2]
        more_r, more_g, more_b = materials[m, 3] - base_r, materials[m, 4] - base_g, materials[m, 5] - base_b
        rough, f0, metal, glow = materials[m, 6], materials[m, 7], materials[m, 8], materials[m, 12]
        tint = materials[m, 13] if scale > zero else zero
        bump = materials[m, 10] if scale > zero else zero
        pattern = materials[m, 11] * f32(PATTERN_TEXELS)
        dy = (run_y[run] - cy) * inv_fy
        bx, by, bz = r10 * dy + r20, r11 * dy + r21, r12 * dy + r22
        weight = run_weight[run]
        left = min(run_length[run] - done, CHUNK - n)
        while left > 0:
            x0 = run_x[run] + f32(done)
            w0, step = f32(gx * x0 + w_run), f32(gx)
            c = np.uint32(0)
            if shadows:  # the tightest map that holds the first and the last pixel
                last = f32(min(left, 8) - 1)
                for end in range(2):
                    ahead = last if end else zero
                    z = one / (w0 + step * ahead)
                    dx = (x0 + ahead - cx) * inv_fx
                    px, py, pz = ex + z * (r00 * dx + bx), ey + z * (r01 * dx + by), ez + z * (r02 * dx + bz)
                    away = px * px + py * py + pz * pz
                    c = max(c, np.uint32(np.uint32(away > tight) + np.uint32(away > middle)))
            u0, u1, u2, u3 = map_affine[c, 0], map_affine[c, 1], map_affine[c, 2], map_affine[c, 3]
            v0, v1, v2, v3 = map_affine[c, 4], map_affine[c, 5], map_affine[c, 6], map_affine[c, 7]
            h0, h1, h2, h3, push = (
                map_affine[c, 8], map_affine[c, 9], map_affine[c, 10], map_affine[c, 11], map_affine[c, 12]
            )  # fmt: skip
            span = f32(map_size[c] if shadows else 0)
            edge, map_place = f32(span - f32(2.0)), f32(map_start[c] if shadows else 0)
            pixel = f32(run_pixel[run] + done)
            lanes = s[n:]  # with a start of its own, so that LLVM sees that no two stores of the loop meet
            for k in range(np.uint64(8)):
                ahead = f32(np.int32(k))
                z = one / (w0 + step * ahead)
                dx = (x0 + ahead - cx) * inv_fx
                rx, ry, rz = r00 * dx + bx, r01 * dx + by, r02 * dx + bz
                px, py, pz = ex + z * rx, ey + z * ry, ez + z * rz
                nx = n0 + n00 * px + n01 * py + n02 * pz
                ny = n1 + n10 * px + n11 * py + n12 * pz
                nz = n2 + n20 * px + n21 * py + n22 * pz
                ray = math.sqrt(rx * rx + ry * ry + rz * rz)
                toward = nx * rx + ny * ry + nz * rz
                sign = f32(-1.0) if both * toward > zero else one
                nx, ny, nz = nx * sign, ny * sign, nz * sign
                back = -one / ray
                lanes[NX * STRIDE + k], lanes[NY * STRIDE + k], lanes[NZ * STRIDE + k] = nx, ny, nz
                lanes[VX * STRIDE + k], lanes[VY * STRIDE + k], lanes[VZ * STRIDE + k] = rx * back, ry * back, rz * back
                lanes[DIST * STRIDE + k] = z * ray
                lanes[TU * STRIDE + k] = gu + sux * px + suy * py + suz * pz
                lanes[TV * STRIDE + k] = gv + svx * px + svy * py + svz * pz
                lanes[FOOT * STRIDE + k] = z * grain * scale / max(abs(toward * back), f32(0.3))
                ao = ga + gax * px + gay * py + gaz * pz
                lanes[AO * STRIDE + k] = min(max(ao, zero), one)
                # where the Sun's map holds this point, pushed off the surface
                px, py, pz = px + nx * push, py + ny * push, pz + nz * push
                u, v = u0 * px + u1 * py + u2 * pz + u3, v0 * px + v1 * py + v2 * pz + v3
                u, v = min(max(u, zero), edge), min(max(v, zero), edge)
                iu, iv = f32(np.int32(u)), f32(np.int32(v))
                high = h0 * px + h1 * py + h2 * pz + h3
                lanes[FU * STRIDE + k], lanes[FV * STRIDE + k] = u - iu, v - iv
                # below everything, so dark, where it is turned away
                lanes[HIGH * STRIDE + k] = high if nx * sx + ny * sy + nz * sz > zero else f32(-2e9)
                lanes[TEXEL * STRIDE + k] = map_place + iv * span + iu
                lanes[SPAN * STRIDE + k] = span
                lanes[UX * STRIDE + k], lanes[UY * STRIDE + k], lanes[UZ * STRIDE + k] = gux, guy, guz
                lanes[WX * STRIDE + k], lanes[WY * STRIDE + k], lanes[WZ * STRIDE + k] = gvx, gvy, gvz
                lanes[AR * STRIDE + k], lanes[AG * STRIDE + k], lanes[AB * STRIDE + k] = base_r, base_g, base_b
                lanes[SR * STRIDE + k], lanes[SG * STRIDE + k], lanes[SB * STRIDE + k] = more_r, more_g, more_b
                lanes[ROUGH * STRIDE + k], lanes[F0 * STRIDE + k], lanes[METAL * STRIDE + k] = rough, f0, metal
                lanes[EMIT * STRIDE + k], lanes[TINT * STRIDE + k], lanes[BUMP * STRIDE + k] = glow, tint, bump
                lanes[PATTERN * STRIDE + k] = pattern
                lanes[PIXEL * STRIDE + k], lanes[WEIGHT * STRIDE + k] = pixel + ahead, weight
            took = min(left, 8)
            left -= took
            n += took
            done += took
        if done >= run_length[run]:
            run += 1
            done = 0
    return run, done, n
