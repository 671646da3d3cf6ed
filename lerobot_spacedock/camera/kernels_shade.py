"""Light: turn the visible triangles of a band of rows into colour (deferred shading in chunks of fragments).

A fragment is one triangle's share of one pixel. The gathering loop is scalar, the lighting loop is written so that LLVM
vectorises it: one scratch array, strides known at compile time, no calls, no libm.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .kernels_raster import JIT

CHUNK = 512
TILE = 256  # texels along a pattern's side; then its mip levels
LEVELS = 9
LEVEL_START = tuple(int(sum((TILE >> j) ** 2 for j in range(level))) for level in range(LEVELS))
PATTERN_TEXELS = int(sum((TILE >> j) ** 2 for j in range(LEVELS)))
_START = np.array(LEVEL_START, np.int64)

# rows of the scratch array
NX, NY, NZ, VX, VY, VZ, AR, AG, AB, ROUGH, F0, METAL, AO, SUN, EMIT, DIST, OUT_R, OUT_G, OUT_B = range(19)
SCRATCH_ROWS = 19

# places in the light array: Sun direction, Sun colour, Earth colour, fill colour, lamp, exposure
SUN_DIR, SUN_RGB, EARTH_RGB, FILL_RGB, LAMP_RGB, EXPOSURE, LAMP_SOFT_m2, LAMP_ON = 0, 3, 6, 9, 12, 15, 16, 17
LIGHT_SIZE = 18

# columns of the material table
M_BASE, M_SECOND, M_ROUGH, M_F0, M_METAL, M_SCALE, M_BUMP, M_PATTERN, M_EMIT, M_TINT = 0, 3, 6, 7, 8, 9, 10, 11, 12, 13
MATERIAL_SIZE = 14

# columns of the triangle table: normal, u, v and openness are each affine in position
T_N, T_U, T_V, T_AO = 0, 12, 16, 20
TRIANGLE_SIZE = 24


@njit(**JIT)
def collect(depth, ids, row0, row1, width, samples, off_x, frag_x, frag_y, frag_tri, frag_pixel, frag_weight, sky):
    """List the band's fragments: one per distinct triangle and pixel, at the centroid of its samples.

    Returns:
        The number of fragments. ``sky`` gets the share of each pixel where nothing was hit.
    """
    n = 0
    share = np.float32(1.0 / samples)
    for i in range(row1 - row0):
        line = i * samples * width
        for j in range(width):
            p = line + j
            pixel = i * width + j
            t0 = ids[p]
            same = True
            for s in range(1, samples):
                if ids[p + s * width] != t0:
                    same = False
            if same:
                if t0 < 0:
                    sky[pixel] = np.float32(1.0)
                else:
                    sky[pixel] = np.float32(0.0)
                    frag_x[n] = np.float32(j + 0.5)
                    frag_y[n] = np.float32(row0 + i + 0.5)
                    frag_tri[n], frag_pixel[n], frag_weight[n] = t0, pixel, np.float32(1.0)
                    n += 1
                continue
            empty = 0
            for s in range(samples):
                t = ids[p + s * width]
                if t < 0:
                    empty += 1
                    continue
                seen = False
                for r in range(s):
                    if ids[p + r * width] == t:
                        seen = True
                if seen:
                    continue
                count = 0
                x = y = np.float32(0.0)
                for r in range(s, samples):
                    if ids[p + r * width] == t:
                        count += 1
                        x += np.float32(off_x[r])
                        y += np.float32((r + 0.5) / samples)
                frag_x[n] = np.float32(j) + x / np.float32(count)
                frag_y[n] = np.float32(row0 + i) + y / np.float32(count)
                frag_tri[n], frag_pixel[n], frag_weight[n] = t, pixel, np.float32(count) * share
                n += 1
            sky[pixel] = np.float32(empty) * share
    return n


@njit(**JIT)
def lit_by_sun(x, y, z, nx, ny, nz, maps, map_start, map_size, map_affine):
    """Share of the Sun seen at a point (0..1): the tightest shadow map that holds it, four taps, bilinear."""
    for c in range(map_size.shape[0]):
        size = map_size[c]
        push = map_affine[c, 12]
        qx, qy, qz = x + nx * push, y + ny * push, z + nz * push
        u = map_affine[c, 0] * qx + map_affine[c, 1] * qy + map_affine[c, 2] * qz + map_affine[c, 3]
        v = map_affine[c, 4] * qx + map_affine[c, 5] * qy + map_affine[c, 6] * qz + map_affine[c, 7]
        if u < np.float32(1.0) or v < np.float32(1.0):
            continue
        iu, iv = int(u), int(v)
        if iu >= size - 2 or iv >= size - 2:
            continue
        h = map_affine[c, 8] * qx + map_affine[c, 9] * qy + map_affine[c, 10] * qz + map_affine[c, 11]
        fu, fv = u - np.float32(iu), v - np.float32(iv)
        p = map_start[c] + iv * size + iu
        one, zero = np.float32(1.0), np.float32(0.0)
        a = zero if maps[p] > h else one
        b = zero if maps[p + 1] > h else one
        d = zero if maps[p + size] > h else one
        e = zero if maps[p + size + 1] > h else one
        top = a + fu * (b - a)
        low = d + fu * (e - d)
        return top + fv * (low - top)
    return np.float32(1.0)


@njit(**JIT)
def gather(k0, n, frag_x, frag_y, frag_tri, plane, owner, table, faces, kind, materials, texels, maps, map_start,
           map_size, map_affine, rot, eye, view, light, scratch):  # fmt: skip
    """Fill the scratch array for fragments k0 .. k0+n: position, bumped normal, surface and Sun share."""
    ex, ey, ez = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    inv_fx, inv_fy = np.float32(1.0 / view[0]), np.float32(1.0 / view[1])
    cx, cy = np.float32(view[2]), np.float32(view[3])
    r00, r01, r02 = np.float32(rot[0, 0]), np.float32(rot[0, 1]), np.float32(rot[0, 2])
    r10, r11, r12 = np.float32(rot[1, 0]), np.float32(rot[1, 1]), np.float32(rot[1, 2])
    r20, r21, r22 = np.float32(rot[2, 0]), np.float32(rot[2, 1]), np.float32(rot[2, 2])
    sx, sy, sz = light[0], light[1], light[2]
    one, zero, mask8 = np.float32(1.0), np.float32(0.0), np.uint32(255)
    byte = np.float32(1.0 / 255.0)
    for k in range(n):
        t = frag_tri[k0 + k]
        f = owner[t]
        fx, fy = frag_x[k0 + k], frag_y[k0 + k]
        w = np.float32(plane[t, 0] * fx + plane[t, 1] * fy + plane[t, 2])
        z = one / w
        dx, dy = (fx - cx) * inv_fx, (fy - cy) * inv_fy
        rx = r00 * dx + r10 * dy + r20
        ry = r01 * dx + r11 * dy + r21
        rz = r02 * dx + r12 * dy + r22
        x, y, zz = ex + z * rx, ey + z * ry, ez + z * rz
        nx = table[f, 0] + table[f, 3] * x + table[f, 4] * y + table[f, 5] * zz
        ny = table[f, 1] + table[f, 6] * x + table[f, 7] * y + table[f, 8] * zz
        nz = table[f, 2] + table[f, 9] * x + table[f, 10] * y + table[f, 11] * zz
        if faces[f, 4] != zero and nx * rx + ny * ry + nz * rz > zero:
            nx, ny, nz = -nx, -ny, -nz
        ray = math.sqrt(rx * rx + ry * ry + rz * rz)
        m = kind[f]
        tint = one
        second = zero
        gnx, gny, gnz = nx, ny, nz
        scale = materials[m, 9]
        if scale > zero:
            gux, guy, guz = table[f, 13], table[f, 14], table[f, 15]
            gvx, gvy, gvz = table[f, 17], table[f, 18], table[f, 19]
            u = (table[f, 12] + gux * x + guy * y + guz * zz) * scale
            v = (table[f, 16] + gvx * x + gvy * y + gvz * zz) * scale
            slant = max(abs(nx * rx + ny * ry + nz * rz) / ray, np.float32(0.3))
            foot = z * inv_fx * scale * np.float32(TILE) / slant
            level = 0
            while foot > np.float32(1.5) and level < LEVELS - 1:
                foot *= np.float32(0.5)
                level += 1
            side = TILE >> level
            bits = side - 1
            fside = np.float32(side)
            u = (u - np.floor(u)) * fside
            v = (v - np.floor(v)) * fside
            iu, iv = int(u), int(v)
            fu, fv = u - np.float32(iu), v - np.float32(iv)
            start = int(materials[m, 11]) * PATTERN_TEXELS + _START[level]
            iu0, iu1 = iu & bits, (iu + 1) & bits
            row_a, row_b = start + (iv & bits) * side, start + ((iv + 1) & bits) * side
            ta, tb, tc, td = texels[row_a + iu0], texels[row_a + iu1], texels[row_b + iu0], texels[row_b + iu1]
            wa, wb = (one - fu) * (one - fv) * byte, fu * (one - fv) * byte
            wc, wd = (one - fu) * fv * byte, fu * fv * byte
            shade = (
                np.float32(ta & mask8) * wa + np.float32(tb & mask8) * wb
                + np.float32(tc & mask8) * wc + np.float32(td & mask8) * wd
            )  # fmt: skip
            second = (
                np.float32((ta >> np.uint32(8)) & mask8) * wa + np.float32((tb >> np.uint32(8)) & mask8) * wb
                + np.float32((tc >> np.uint32(8)) & mask8) * wc + np.float32((td >> np.uint32(8)) & mask8) * wd
            )  # fmt: skip
            bump_u = (
                np.float32((ta >> np.uint32(16)) & mask8) * wa + np.float32((tb >> np.uint32(16)) & mask8) * wb
                + np.float32((tc >> np.uint32(16)) & mask8) * wc + np.float32((td >> np.uint32(16)) & mask8) * wd
            ) - np.float32(128.0 / 255.0)  # fmt: skip
            bump_v = (
                np.float32(ta >> np.uint32(24)) * wa + np.float32(tb >> np.uint32(24)) * wb
                + np.float32(tc >> np.uint32(24)) * wc + np.float32(td >> np.uint32(24)) * wd
            ) - np.float32(128.0 / 255.0)  # fmt: skip
            tint = one + materials[m, 13] * (shade * np.float32(2.0) - one)
            bump = materials[m, 10]
            nx -= bump * (bump_u * gux + bump_v * gvx)
            ny -= bump * (bump_u * guy + bump_v * gvy)
            nz -= bump * (bump_u * guz + bump_v * gvz)
        lit = zero
        if light[3] > zero and gnx * sx + gny * sy + gnz * sz > np.float32(-0.1):
            lit = lit_by_sun(x, y, zz, gnx, gny, gnz, maps, map_start, map_size, map_affine)
        ao = table[f, 20] + table[f, 21] * x + table[f, 22] * y + table[f, 23] * zz
        back = -one / ray
        scratch[NX * CHUNK + k], scratch[NY * CHUNK + k], scratch[NZ * CHUNK + k] = nx, ny, nz
        scratch[VX * CHUNK + k], scratch[VY * CHUNK + k], scratch[VZ * CHUNK + k] = rx * back, ry * back, rz * back
        scratch[AR * CHUNK + k] = (materials[m, 0] + second * (materials[m, 3] - materials[m, 0])) * tint
        scratch[AG * CHUNK + k] = (materials[m, 1] + second * (materials[m, 4] - materials[m, 1])) * tint
        scratch[AB * CHUNK + k] = (materials[m, 2] + second * (materials[m, 5] - materials[m, 2])) * tint
        scratch[ROUGH * CHUNK + k], scratch[F0 * CHUNK + k] = materials[m, 6], materials[m, 7]
        scratch[METAL * CHUNK + k], scratch[EMIT * CHUNK + k] = materials[m, 8], materials[m, 12]
        scratch[AO * CHUNK + k], scratch[SUN * CHUNK + k] = min(max(ao, zero), one), lit
        scratch[DIST * CHUNK + k] = z * ray


@njit(**JIT)
def lighten(n, light, s):
    """Light, expose and tone-map n fragments of the scratch array (vectorised)."""
    lx, ly, lz = light[0], light[1], light[2]
    sr, sg, sb = light[3], light[4], light[5]
    er, eg, eb = light[6], light[7], light[8]
    ar, ag, ab = light[9], light[10], light[11]
    pr, pg, pb = light[12], light[13], light[14]
    exposure, soft = light[15], light[16]
    one, zero, half = np.float32(1.0), np.float32(0.0), np.float32(0.5)
    tiny = np.float32(1e-6)
    for k in range(n):
        nx, ny, nz = s[NX * CHUNK + k], s[NY * CHUNK + k], s[NZ * CHUNK + k]
        inv = one / math.sqrt(nx * nx + ny * ny + nz * nz + tiny)
        nx, ny, nz = nx * inv, ny * inv, nz * inv
        vx, vy, vz = s[VX * CHUNK + k], s[VY * CHUNK + k], s[VZ * CHUNK + k]
        f0, metal, rough = s[F0 * CHUNK + k], s[METAL * CHUNK + k], s[ROUGH * CHUNK + k]
        cr, cg, cb = s[AR * CHUNK + k], s[AG * CHUNK + k], s[AB * CHUNK + k]
        ao, lit = s[AO * CHUNK + k], s[SUN * CHUNK + k]
        nv = max(nx * vx + ny * vy + nz * vz, np.float32(0.03))
        nl = max(nx * lx + ny * ly + nz * lz, zero)
        hx, hy, hz = lx + vx, ly + vy, lz + vz
        hh = one / math.sqrt(hx * hx + hy * hy + hz * hz + tiny)
        nh = min(max((nx * hx + ny * hy + nz * hz) * hh, zero), one)
        vh = min(max((vx * hx + vy * hy + vz * hz) * hh, zero), one)
        alpha = rough * rough
        a2 = alpha * alpha
        den = nh * nh * (a2 - one) + one
        glint = a2 / (den * den)
        reach = half / (nl * (nv * (one - alpha) + alpha) + nv * (nl * (one - alpha) + alpha) + np.float32(1e-4))
        g = one - vh
        fresnel = g * g * g * g * g
        spec = glint * reach * nl * lit
        # the lamp sits beside the lens: light, view and half vector are one
        dist = s[DIST * CHUNK + k]
        lamp = nv / (dist * dist + soft)
        den = nv * nv * (a2 - one) + one
        spec_lamp = a2 / (den * den) * lamp / (np.float32(4.0) * (nv * (one - alpha) + alpha))
        # Earth below: half a sphere of it, and its mirror image in smooth surfaces
        earth = half * (one - nx) * ao
        mirror = np.float32(2.0) * nv * nx - vx
        seen = min(max((np.float32(-0.25) - mirror) * np.float32(4.0), zero), one) * ao
        g = one - nv
        fresnel_env = g * g * g * g * g
        gloss = (one - rough) * (one - rough)
        dull = one - metal
        fr, fg, fb = f0 * dull + cr * metal, f0 * dull + cg * metal, f0 * dull + cb * metal
        env = seen * gloss + earth * (one - gloss)
        er_ = fr + (one - fr) * fresnel_env * gloss
        eg_ = fg + (one - fg) * fresnel_env * gloss
        eb_ = fb + (one - fb) * fresnel_env * gloss
        diff = nl * lit
        glow = s[EMIT * CHUNK + k]
        red = dull * cr * (sr * diff + er * earth + ar * ao + pr * lamp) + er_ * er * env + fr * pr * spec_lamp
        green = dull * cg * (sg * diff + eg * earth + ag * ao + pg * lamp) + eg_ * eg * env + fg * pg * spec_lamp
        blue = dull * cb * (sb * diff + eb * earth + ab * ao + pb * lamp) + eb_ * eb * env + fb * pb * spec_lamp
        red = (red + sr * spec * (fr + (one - fr) * fresnel) + metal * cr * ar * ao) * exposure + glow * cr
        green = (green + sg * spec * (fg + (one - fg) * fresnel) + metal * cg * ag * ao) * exposure + glow * cg
        blue = (blue + sb * spec * (fb + (one - fb) * fresnel) + metal * cb * ab * ao) * exposure + glow * cb
        s[OUT_R * CHUNK + k], s[OUT_G * CHUNK + k], s[OUT_B * CHUNK + k] = red, green, blue


@njit(**JIT)
def tone_map(n, s):
    """Film-like curve on n fragments (a rational fit of the ACES reference curve)."""
    a, b, c, d, e = np.float32(2.51), np.float32(0.03), np.float32(2.43), np.float32(0.59), np.float32(0.14)
    for k in range(OUT_R * CHUNK, OUT_R * CHUNK + n):
        x = min(s[k], np.float32(60.0))
        s[k] = x * (a * x + b) / (x * (c * x + d) + e)
    for k in range(OUT_G * CHUNK, OUT_G * CHUNK + n):
        x = min(s[k], np.float32(60.0))
        s[k] = x * (a * x + b) / (x * (c * x + d) + e)
    for k in range(OUT_B * CHUNK, OUT_B * CHUNK + n):
        x = min(s[k], np.float32(60.0))
        s[k] = x * (a * x + b) / (x * (c * x + d) + e)


@njit(**JIT)
def deposit(k0, n, frag_pixel, frag_weight, s, colour):
    """Add n fragments' colours to the band's pixels."""
    for k in range(n):
        p = 3 * frag_pixel[k0 + k]
        w = frag_weight[k0 + k]
        colour[p] += w * s[OUT_R * CHUNK + k]
        colour[p + 1] += w * s[OUT_G * CHUNK + k]
        colour[p + 2] += w * s[OUT_B * CHUNK + k]


@njit(**JIT)
def encode(colour, n, out, start):
    """Linear 0..1 → sRGB bytes, the power replaced by square roots (within half a grey level)."""
    for k in range(n):
        x = min(max(colour[k], np.float32(0.0)), np.float32(1.0))
        a = math.sqrt(x)
        b = math.sqrt(a)
        c = math.sqrt(b)
        y = (
            np.float32(0.662002687) * a
            + np.float32(0.684122060) * b
            - np.float32(0.323583601) * c
            - np.float32(0.0225411470) * x
        )
        y = np.float32(12.92) * x if x < np.float32(0.0031308) else y
        out[start + k] = np.uint8(min(max(y, np.float32(0.0)), np.float32(1.0)) * np.float32(255.0) + np.float32(0.5))
