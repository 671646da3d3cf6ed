"""Light: turn the visible triangles of a band of rows into colour (deferred shading in chunks of fragments).

A fragment is one triangle's share of one pixel. The gathering loop is scalar, the lighting loop is written so that LLVM
vectorises it: one scratch array, strides known at compile time, no calls, no libm.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

CHUNK = 256  # the scratch array then stays in the first-level cache
TILE = 256  # texels along a pattern's side; then its mip levels
LEVELS = 9
LEVEL_START = tuple(int(sum((TILE >> j) ** 2 for j in range(level))) for level in range(LEVELS))
PATTERN_TEXELS = int(sum((TILE >> j) ** 2 for j in range(LEVELS)))
_START = np.array(LEVEL_START, np.int64)

# rows of the scratch array
NX, NY, NZ, VX, VY, VZ, AR, AG, AB, ROUGH, F0, METAL, AO, SUN, EMIT, DIST, OUT_R, OUT_G, OUT_B = range(19)
PX, PY, PZ, TU, TV, FOOT, UX, UY, UZ, WX, WY, WZ, KIND, FU, FV, HIGH = range(
    16, 32
)  # the first three are free until OUT is written
SCRATCH_ROWS = 32

# places in the light array: Sun direction, Sun colour, Earth colour, fill colour, lamp, exposure
SUN_DIR, SUN_RGB, EARTH_RGB, FILL_RGB, LAMP_RGB, EXPOSURE, LAMP_SOFT_m2, LAMP_ON = 0, 3, 6, 9, 12, 15, 16, 17
LIGHT_SIZE = 18

# columns of the material table
M_BASE, M_SECOND, M_ROUGH, M_F0, M_METAL, M_SCALE, M_BUMP, M_PATTERN, M_EMIT, M_TINT = 0, 3, 6, 7, 8, 9, 10, 11, 12, 13
MATERIAL_SIZE = 14

# columns of the triangle table: normal, u, v and openness are each affine in position; material; two-sided flag
T_N, T_U, T_V, T_AO, T_KIND, T_BOTH = 0, 12, 16, 20, 24, 25
TRIANGLE_SIZE = 32  # two whole cache lines


@jit(nogil=True)
def collect(ids, row0, row1, width, samples, off_x, frag_x, frag_y, frag_tri, frag_pixel, frag_weight, sky):
    """List the band's fragments: one per distinct triangle and pixel, at the centroid of its samples.

    Returns:
        The number of fragments. ``sky`` gets the share of each pixel where nothing was hit.
    """
    n = 0
    full, none = np.float32(1.0), np.float32(0.0)
    for i in range(row1 - row0):
        line = i * samples * width
        y = np.float32(row0 + i + 0.5)
        for j in range(width):
            p = line + j
            pixel = i * width + j
            t = ids[p]
            if samples == 1 or (t == ids[p + width] and t == ids[p + 2 * width] and t == ids[p + 3 * width]):
                if t < 0:
                    sky[pixel] = full
                else:
                    sky[pixel] = none
                    frag_x[n] = np.float32(j) + np.float32(0.5)
                    frag_y[n] = y
                    frag_tri[n], frag_pixel[n], frag_weight[n] = t, pixel, full
                    n += 1
            else:
                n = _split(
                    ids, p, width, row0 + i, j, pixel, off_x, frag_x, frag_y, frag_tri, frag_pixel, frag_weight, sky, n
                )
    return n


@jit(nogil=True)
def _split(ids, p, width, row, column, pixel, off_x, frag_x, frag_y, frag_tri, frag_pixel, frag_weight, sky, n):
    """The fragments of a pixel whose four samples differ; → number of fragments so far."""
    empty = 0
    for s in range(4):
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
        for r in range(s, 4):
            if ids[p + r * width] == t:
                count += 1
                x += np.float32(off_x[r])
                y += np.float32(0.25 * r + 0.125)
        inv = np.float32(1.0) / np.float32(count)
        frag_x[n] = np.float32(column) + x * inv
        frag_y[n] = np.float32(row) + y * inv
        frag_tri[n], frag_pixel[n], frag_weight[n] = t, pixel, np.float32(0.25) * np.float32(count)
        n += 1
    sky[pixel] = np.float32(0.25) * np.float32(empty)
    return n


@jit(nogil=True)
def locate(k0, n, frag_x, frag_y, frag_tri, plane, table, materials, rot, eye, view, s):
    """Position, normal, texture place and openness of fragments k0 .. k0+n."""
    ex, ey, ez = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    inv_fx, inv_fy = np.float32(1.0 / view[0]), np.float32(1.0 / view[1])
    cx, cy = np.float32(view[2]), np.float32(view[3])
    r00, r01, r02 = np.float32(rot[0, 0]), np.float32(rot[0, 1]), np.float32(rot[0, 2])
    r10, r11, r12 = np.float32(rot[1, 0]), np.float32(rot[1, 1]), np.float32(rot[1, 2])
    r20, r21, r22 = np.float32(rot[2, 0]), np.float32(rot[2, 1]), np.float32(rot[2, 2])
    one, zero = np.float32(1.0), np.float32(0.0)
    grain = inv_fx * np.float32(TILE)
    for k in range(n):
        # unsigned indices spare a wrap-around test each
        t = np.uint32(frag_tri[k0 + k])
        fx, fy = frag_x[k0 + k], frag_y[k0 + k]
        z = one / np.float32(plane[t, 0] * fx + plane[t, 1] * fy + plane[t, 2])
        f = np.uint32(plane[t, 3])
        dx, dy = (fx - cx) * inv_fx, (fy - cy) * inv_fy
        rx = r00 * dx + r10 * dy + r20
        ry = r01 * dx + r11 * dy + r21
        rz = r02 * dx + r12 * dy + r22
        x, y, h = ex + z * rx, ey + z * ry, ez + z * rz
        nx = table[f, 0] + table[f, 3] * x + table[f, 4] * y + table[f, 5] * h
        ny = table[f, 1] + table[f, 6] * x + table[f, 7] * y + table[f, 8] * h
        nz = table[f, 2] + table[f, 9] * x + table[f, 10] * y + table[f, 11] * h
        ray = math.sqrt(rx * rx + ry * ry + rz * rz)
        toward = nx * rx + ny * ry + nz * rz
        if table[f, 25] != zero and toward > zero:
            nx, ny, nz = -nx, -ny, -nz
        back = -one / ray
        m = table[f, 24]
        scale = materials[np.uint32(m), 9]
        gux, guy, guz = table[f, 13], table[f, 14], table[f, 15]
        gvx, gvy, gvz = table[f, 17], table[f, 18], table[f, 19]
        s[NX * CHUNK + k], s[NY * CHUNK + k], s[NZ * CHUNK + k] = nx, ny, nz
        s[VX * CHUNK + k], s[VY * CHUNK + k], s[VZ * CHUNK + k] = rx * back, ry * back, rz * back
        s[PX * CHUNK + k], s[PY * CHUNK + k], s[PZ * CHUNK + k] = x, y, h
        s[TU * CHUNK + k] = (table[f, 12] + gux * x + guy * y + guz * h) * scale
        s[TV * CHUNK + k] = (table[f, 16] + gvx * x + gvy * y + gvz * h) * scale
        s[FOOT * CHUNK + k] = z * grain * scale / max(abs(toward * back), np.float32(0.3))
        s[UX * CHUNK + k], s[UY * CHUNK + k], s[UZ * CHUNK + k] = gux, guy, guz
        s[WX * CHUNK + k], s[WY * CHUNK + k], s[WZ * CHUNK + k] = gvx, gvy, gvz
        ao = table[f, 20] + table[f, 21] * x + table[f, 22] * y + table[f, 23] * h
        s[AO * CHUNK + k] = min(max(ao, zero), one)
        s[DIST * CHUNK + k] = z * ray
        s[KIND * CHUNK + k] = m


@jit(nogil=True)
def shade_shadow(n, light, maps, map_start, map_size, map_affine, map_reach, s, place):
    """Share of the Sun that reaches n fragments (0..1): the tightest map around the point, four taps, bilinear.

    Two loops: the first finds the texels without branches, so that in the second many slow reads are under way at once.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    sx, sy, sz = light[0], light[1], light[2]
    if map_size.shape[0] == 0 or light[3] <= zero:
        lit = one if light[3] > zero else zero
        for k in range(n):
            s[SUN * CHUNK + k] = lit
        return
    tight, middle = map_reach[0], map_reach[1]
    for k in range(n):
        nx, ny, nz = s[NX * CHUNK + k], s[NY * CHUNK + k], s[NZ * CHUNK + k]
        x, y, z = s[PX * CHUNK + k], s[PY * CHUNK + k], s[PZ * CHUNK + k]
        away = x * x + y * y + z * z
        c = np.uint32(int(away > tight) + int(away > middle))
        push = map_affine[c, 12]
        x, y, z = x + nx * push, y + ny * push, z + nz * push
        u = map_affine[c, 0] * x + map_affine[c, 1] * y + map_affine[c, 2] * z + map_affine[c, 3]
        v = map_affine[c, 4] * x + map_affine[c, 5] * y + map_affine[c, 6] * z + map_affine[c, 7]
        edge = np.float32(map_size[c] - 2)
        u, v = min(max(u, zero), edge), min(max(v, zero), edge)
        iu, iv = int(u), int(v)
        faces_sun = nx * sx + ny * sy + nz * sz > zero
        s[FU * CHUNK + k], s[FV * CHUNK + k] = u - np.float32(iu), v - np.float32(iv)
        h = map_affine[c, 8] * x + map_affine[c, 9] * y + map_affine[c, 10] * z + map_affine[c, 11]
        s[HIGH * CHUNK + k] = h if faces_sun else np.float32(-2e9)  # below everything: dark
        place[2 * k] = map_start[c] + iv * map_size[c] + iu if faces_sun else 0
        place[2 * k + 1] = map_size[c]
    for k in range(n):
        h, fu, fv = s[HIGH * CHUNK + k], s[FU * CHUNK + k], s[FV * CHUNK + k]
        p, size = np.uint64(place[2 * k]), np.uint64(place[2 * k + 1])
        q = p + size
        a = zero if maps[p] > h else one
        b = zero if maps[p + np.uint64(1)] > h else one
        d = zero if maps[q] > h else one
        e = zero if maps[q + np.uint64(1)] > h else one
        top = a + fu * (b - a)
        low = d + fu * (e - d)
        s[SUN * CHUNK + k] = top + fv * (low - top)


@jit(nogil=True)
def clothe(n, materials, texels, s):
    """Colour, gloss and relief of n fragments from their material and its pattern."""
    one, zero = np.float32(1.0), np.float32(0.0)
    byte, middle = np.float32(1.0 / 255.0), np.float32(128.0 / 255.0)
    for k in range(n):
        m = np.uint32(s[KIND * CHUNK + k])
        tint = one
        second = zero
        if materials[m, 9] > zero:
            u, v, foot = s[TU * CHUNK + k], s[TV * CHUNK + k], s[FOOT * CHUNK + k]
            level = 0
            while foot > np.float32(1.5) and level < LEVELS - 1:
                foot *= np.float32(0.5)
                level += 1
            side = TILE >> level
            bits = side - 1
            u = (u - np.floor(u)) * np.float32(side)
            v = (v - np.floor(v)) * np.float32(side)
            iu, iv = int(u), int(v)
            fu, fv = u - np.float32(iu), v - np.float32(iv)
            start = int(materials[m, 11]) * PATTERN_TEXELS + _START[level]
            iu0, iu1 = iu & bits, (iu + 1) & bits
            row_a, row_b = start + (iv & bits) * side, start + ((iv + 1) & bits) * side
            ta, tb = texels[np.uint64(row_a + iu0)], texels[np.uint64(row_a + iu1)]
            tc, td = texels[np.uint64(row_b + iu0)], texels[np.uint64(row_b + iu1)]
            fu1, fv1 = (one - fu) * byte, one - fv
            fu = fu * byte
            wa, wb, wc, wd = fu1 * fv1, fu * fv1, fu1 * fv, fu * fv
            shade = (
                np.float32(ta & 255) * wa + np.float32(tb & 255) * wb
                + np.float32(tc & 255) * wc + np.float32(td & 255) * wd
            )  # fmt: skip
            second = (
                np.float32((ta >> 8) & 255) * wa + np.float32((tb >> 8) & 255) * wb
                + np.float32((tc >> 8) & 255) * wc + np.float32((td >> 8) & 255) * wd
            )  # fmt: skip
            tint = one + materials[m, 13] * (shade * np.float32(2.0) - one)
            if level < 5:
                bump_u = (
                    np.float32((ta >> 16) & 255) * wa + np.float32((tb >> 16) & 255) * wb
                    + np.float32((tc >> 16) & 255) * wc + np.float32((td >> 16) & 255) * wd
                ) - middle  # fmt: skip
                bump_v = (
                    np.float32((ta >> 24) & 255) * wa + np.float32((tb >> 24) & 255) * wb
                    + np.float32((tc >> 24) & 255) * wc + np.float32((td >> 24) & 255) * wd
                ) - middle  # fmt: skip
                bump = materials[m, 10]
                bump_u *= bump
                bump_v *= bump
                s[NX * CHUNK + k] -= bump_u * s[UX * CHUNK + k] + bump_v * s[WX * CHUNK + k]
                s[NY * CHUNK + k] -= bump_u * s[UY * CHUNK + k] + bump_v * s[WY * CHUNK + k]
                s[NZ * CHUNK + k] -= bump_u * s[UZ * CHUNK + k] + bump_v * s[WZ * CHUNK + k]
        s[AR * CHUNK + k] = (materials[m, 0] + second * (materials[m, 3] - materials[m, 0])) * tint
        s[AG * CHUNK + k] = (materials[m, 1] + second * (materials[m, 4] - materials[m, 1])) * tint
        s[AB * CHUNK + k] = (materials[m, 2] + second * (materials[m, 5] - materials[m, 2])) * tint
        s[ROUGH * CHUNK + k], s[F0 * CHUNK + k] = materials[m, 6], materials[m, 7]
        s[METAL * CHUNK + k], s[EMIT * CHUNK + k] = materials[m, 8], materials[m, 12]


@jit(nogil=True)
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


@jit(nogil=True)
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


@jit(nogil=True)
def deposit(k0, n, frag_pixel, frag_weight, s, colour):
    """Add n fragments' colours to the band's pixels."""
    for k in range(n):
        p = 3 * frag_pixel[k0 + k]
        w = frag_weight[k0 + k]
        colour[p] += w * s[OUT_R * CHUNK + k]
        colour[p + 1] += w * s[OUT_G * CHUNK + k]
        colour[p + 2] += w * s[OUT_B * CHUNK + k]


@jit(nogil=True)
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
