"""What is behind the station: Earth with clouds and limb, the Sun's disc, and stars."""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import inner, jit
from lerobot_spacedock.physics.constants import EARTH_EQUATORIAL_RADIUS_m, ORBIT_RADIUS_m

from .kernels_shade import film

CHUNK = 256  # pixels of Earth that are worked on together

EARTH_SIZE = 2048  # texels along the side of the Earth patch that is seen from orbit
EARTH_REACH = 0.37  # sine of the central angle at the patch's edge; the horizon is at 0.342
_RO = ORBIT_RADIUS_m / EARTH_EQUATORIAL_RADIUS_m  # everything below in Earth radii
_HORIZON = math.sqrt(1.0 - 1.0 / (_RO * _RO))  # cosine from the nadir of the geometric horizon
_AIR_TOP = (1.0 + 140e3 / EARTH_EQUATORIAL_RADIUS_m) ** 2  # nothing glows above this


@inner
def _rays(n, pixel, row0, width, rot, view, s):
    """The unit vectors along which ``n`` pixels look, into the sixth, seventh and eighth chunk of ``s``."""
    f32, i32 = np.float32, np.int32
    one = f32(1.0)
    r00, r01, r02 = f32(rot[0, 0]), f32(rot[0, 1]), f32(rot[0, 2])
    r10, r11, r12 = f32(rot[1, 0]), f32(rot[1, 1]), f32(rot[1, 2])
    r20, r21, r22 = f32(rot[2, 0]), f32(rot[2, 1]), f32(rot[2, 2])
    inv_fx, inv_fy = f32(1.0 / view[0]), f32(1.0 / view[1])
    cx, cy = f32(view[2] - 0.5), f32(view[3] - 0.5 - row0)
    for k in range(np.uint64(n)):
        row = pixel[k] // i32(width)
        dx, dy = (f32(pixel[k] - row * i32(width)) - cx) * inv_fx, (f32(row) - cy) * inv_fy
        inv = one / math.sqrt(one + dx * dx + dy * dy)
        rx = (r00 * dx + r10 * dy + r20) * inv
        ry = (r01 * dx + r11 * dy + r21) * inv
        rz = (r02 * dx + r12 * dy + r22) * inv
        s[5 * CHUNK + k], s[6 * CHUNK + k], s[7 * CHUNK + k] = rx, ry, rz


@inner
def _ground(n, pixel, row0, width, sky, rot, view, light, earth, s, taps, colour):
    """Add the sunlit Earth to ``n`` pixels whose rays meet it."""
    f32, i32 = np.float32, np.int32
    one, zero = f32(1.0), f32(0.0)
    ro, ro2 = f32(_RO), f32(_RO * _RO)
    half, per = f32(0.5 * EARTH_SIZE), f32(0.5 * EARTH_SIZE / EARTH_REACH)
    last = f32(EARTH_SIZE - 2)
    sx, sy, sz, exposure = light[0], light[1], light[2], light[15]
    _rays(n, pixel, row0, width, rot, view, s)
    for k in range(np.uint64(n)):
        rx, ry, rz = s[5 * CHUNK + k], s[6 * CHUNK + k], s[7 * CHUNK + k]
        t = -ro * rx - math.sqrt(max(one - ro2 * (one - rx * rx), zero))
        ny, nz = t * ry, t * rz
        u, v = min(max(ny * per + half, zero), last), min(max(nz * per + half, zero), last)
        iu, iv = i32(u), i32(v)
        taps[k] = i32(iv * EARTH_SIZE + iu)
        s[k], s[CHUNK + k], s[2 * CHUNK + k] = ro + t * rx, ny, nz
        s[3 * CHUNK + k], s[4 * CHUNK + k] = u - f32(iu), v - f32(iv)
    for k in range(np.uint64(n)):
        p = np.uint64(taps[k])
        taps[k], taps[CHUNK + k] = earth[p], earth[p + np.uint64(1)]
        q = p + np.uint64(EARTH_SIZE)
        taps[2 * CHUNK + k], taps[3 * CHUNK + k] = earth[q], earth[q + np.uint64(1)]
    byte = f32(1.0 / 255.0)
    for k in range(np.uint64(n)):
        rx, ry, rz = s[5 * CHUNK + k], s[6 * CHUNK + k], s[7 * CHUNK + k]
        nx, ny, nz = s[k], s[CHUNK + k], s[2 * CHUNK + k]
        fu, fv = s[3 * CHUNK + k], s[4 * CHUNK + k]
        ta, tb, tc, td = taps[k], taps[CHUNK + k], taps[2 * CHUNK + k], taps[3 * CHUNK + k]
        wa, wb = (one - fu) * (one - fv) * byte, fu * (one - fv) * byte
        wc, wd = (one - fu) * fv * byte, fu * fv * byte
        gr = f32(i32(ta & 255)) * wa + f32(i32(tb & 255)) * wb + f32(i32(tc & 255)) * wc + f32(i32(td & 255)) * wd
        gg = (
            f32(i32((ta >> 8) & 255)) * wa + f32(i32((tb >> 8) & 255)) * wb
            + f32(i32((tc >> 8) & 255)) * wc + f32(i32((td >> 8) & 255)) * wd
        )  # fmt: skip
        gb = (
            f32(i32((ta >> 16) & 255)) * wa + f32(i32((tb >> 16) & 255)) * wb
            + f32(i32((tc >> 16) & 255)) * wc + f32(i32((td >> 16) & 255)) * wd
        )  # fmt: skip
        gloss = (
            f32(i32((ta >> 24) & 255)) * wa + f32(i32((tb >> 24) & 255)) * wb
            + f32(i32((tc >> 24) & 255)) * wc + f32(i32((td >> 24) & 255)) * wd
        )  # fmt: skip
        mu = max(-(rx * nx + ry * ny + rz * nz), zero)
        sun = nx * sx + ny * sy + nz * sz
        day = min(max((sun + f32(0.06)) * f32(5.0), zero), one)
        day = day * day
        level = day * max(sun, f32(0.02))
        # the Sun's glint on water, broad because of waves
        hx, hy, hz = sx - rx, sy - ry, sz - rz
        nh = max((nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz + f32(1e-6)), zero)
        nh = nh * nh
        nh = nh * nh
        nh = nh * nh
        nh = nh * nh
        nh = nh * nh
        glint = gloss * nh * nh * day * f32(0.6)
        warm = min(max(f32(0.25) - sun, zero) * f32(3.0), one)  # low Sun reddens
        haze = f32(0.05) / (f32(0.05) + mu)
        keep = one - haze
        air = haze * level
        red = keep * (gr * level + glint) + air * f32(0.30) * (one + warm)
        green = keep * (gg * level * (one - f32(0.25) * warm) + glint) + air * f32(0.46)
        blue = keep * (gb * level * (one - f32(0.45) * warm) + glint)
        blue += air * f32(0.80) * (one - f32(0.4) * warm)
        s[k], s[CHUNK + k] = film(red * exposure), film(green * exposure)
        s[2 * CHUNK + k] = film(blue * exposure)
    _share_out(n, pixel, sky, s, colour)


@inner(forceinline=True)
def _limb(rx, ry, rz, down, gap, sx, sy, sz):
    """Radiance (red, green, blue) of the air above the limb along a unit ray that misses the ground."""
    one, zero = np.float32(1.0), np.float32(0.0)
    ro = np.float32(_RO)
    h = (math.sqrt(gap) - one) * np.float32(637.8)  # height of the ray's lowest point, 10 km
    sun = ((ro + ro * down * rx) * sx + ro * down * (ry * sy + rz * sz)) / math.sqrt(gap)
    day = min(max((sun + np.float32(0.12)) * np.float32(4.0), zero), one)
    level = day * min(max(sun, np.float32(0.03)) + np.float32(0.1), one)
    half, sixth = np.float32(0.5), np.float32(0.1666)
    low = one / (one + h * (one + h * (half + h * sixth)))  # stands in for an exponential
    h2 = h * np.float32(0.45)
    high = one / (one + h2 * (one + h2 * (half + h2 * sixth)))
    warm = min(max(np.float32(0.2) - sun, zero) * np.float32(4.0), one)
    glow = h * np.float32(0.1) - np.float32(0.95)  # green airglow, a thin layer near 95 km
    night = np.float32(0.0009) / (one + np.float32(60.0) * glow * glow)
    red = level * (np.float32(0.45) * low * (one + warm) + np.float32(0.02) * high) + night * np.float32(0.4)
    green = level * (np.float32(0.55) * low + np.float32(0.10) * high) + night
    blue = level * (np.float32(0.65) * low * (one - np.float32(0.6) * warm) + np.float32(0.35) * high)
    return red, green, blue + night * np.float32(0.3)


@jit(nogil=True)
def paint_sky(row0, row1, width, sky, rot, view, light, earth, colour):
    """Add the sky's share to the band's pixels, tone-mapped like everything else."""
    f32, i32 = np.float32, np.int32
    one, zero = f32(1.0), f32(0.0)
    inv_fx, inv_fy = f32(1.0 / view[0]), f32(1.0 / view[1])
    cx = f32(view[2] - 0.5)
    sx, sy, sz = light[0], light[1], light[2]
    ro2, air_top = f32(_RO * _RO), f32(_AIR_TOP)
    r00, r01, r02 = f32(rot[0, 0]), f32(rot[0, 1]), f32(rot[0, 2])
    s, taps = np.empty(8 * CHUNK, np.float32), np.empty(4 * CHUNK, np.int32)
    pixel, lit = np.empty(CHUNK + 1, np.int32), np.empty(CHUNK + 1, np.int32)
    kind = np.empty(width, np.int32)
    found, shining = np.int64(0), np.int64(0)  # a literal 0 would have ``_ground`` compiled twice
    for i in range(row1 - row0):
        dy = (f32(row0 + i + 0.5) - f32(view[3])) * inv_fy
        bx = f32(rot[1, 0]) * dy + f32(rot[2, 0])
        by = f32(rot[1, 1]) * dy + f32(rot[2, 1])
        bz = f32(rot[1, 2]) * dy + f32(rot[2, 2])
        row_one = one + dy * dy
        shares = sky[i * width : (i + 1) * width]
        glows = i32(0)
        for j in range(np.uint64(width)):
            dx = (f32(i32(j)) - cx) * inv_fx
            rx = r00 * dx + bx
            rr = row_one + dx * dx  # squared length of the ray
            gap = ro2 * (rr - rx * rx)  # squared distance of the ray from the Earth's centre, times rr
            along = sx * rx + sy * (r01 * dx + by) + sz * (r02 * dx + bz)
            bare, down = shares[j] > zero, rx < zero
            ground = bare & down & (gap < rr)
            near_sun = (along > zero) & (along * along > f32(0.96) * rr)
            glow = bare & (not ground) & ((down & (gap < air_top * rr)) | near_sun)
            kind[j] = i32(ground) + i32(2) * i32(glow)
            glows |= i32(glow)
        for j in range(np.uint64(width)):
            pixel[found] = i32(i32(i * width) + i32(j))
            found += kind[j] & 1
            if found == CHUNK:
                _ground(found, pixel, row0, width, sky, rot, view, light, earth, s, taps, colour)
                found = np.int64(0)
        for j in range(np.uint64(width if glows else 0)):
            lit[shining] = i32(i32(i * width) + i32(j))
            shining += kind[j] >> 1
            if shining == CHUNK:
                _glow(shining, lit, row0, width, sky, rot, view, light, s, colour)
                shining = np.int64(0)
    _glow(shining, lit, row0, width, sky, rot, view, light, s, colour)
    _ground(found, pixel, row0, width, sky, rot, view, light, earth, s, taps, colour)


@inner
def _glow(n, pixel, row0, width, sky, rot, view, light, s, colour):
    """Add the air above the limb, and the Sun with its flare, to ``n`` pixels whose rays miss the ground."""
    f32 = np.float32
    one, zero = f32(1.0), f32(0.0)
    sx, sy, sz, exposure = light[0], light[1], light[2], light[15]
    _rays(n, pixel, row0, width, rot, view, s)
    for k in range(np.uint64(n)):
        rx, ry, rz = s[5 * CHUNK + k], s[6 * CHUNK + k], s[7 * CHUNK + k]
        gap = f32(_RO * _RO) * (one - rx * rx)
        red, green, blue = _limb(rx, ry, rz, -rx, max(gap, one), sx, sy, sz)
        air = one if (rx < zero) & (gap < f32(_AIR_TOP)) else zero
        along = sx * rx + sy * ry + sz * rz
        away = one - along
        flare = f32(6e-6) / (away + f32(2e-6))
        flare = f32(40.0) if away < f32(1.1e-5) else flare  # within the Sun's angular radius
        flare = flare if (along > zero) & (along * along > f32(0.96)) else zero
        s[k] = film((air * red + flare) * exposure)
        s[CHUNK + k] = film((air * green + flare * f32(0.97)) * exposure)
        s[2 * CHUNK + k] = film((air * blue + flare * f32(0.9)) * exposure)
    _share_out(n, pixel, sky, s, colour)


@inner
def _share_out(n, pixel, sky, s, colour):
    """Add ``n`` pixels' colours, for the share of each that the sky has."""
    for k in range(np.uint64(n)):
        share = sky[np.uint64(pixel[k])]
        p = np.uint64(3) * np.uint64(pixel[k])
        colour[p] += share * s[k]
        colour[p + np.uint64(1)] += share * s[CHUNK + k]
        colour[p + np.uint64(2)] += share * s[2 * CHUNK + k]


@jit(nogil=True)
def project_stars(stars, rot, view, width, height, out):
    """Stars in the picture and above the air → rows of (column, row, red, green, blue); their number."""
    n = 0
    # no star farther than the picture's corner from its middle
    right, down = max(view[2], width - view[2]) / view[0], max(view[3], height - view[3]) / view[1]
    least = max(1.0 / math.sqrt(1.0 + right * right + down * down), 1e-3)
    for k in range(stars.shape[0]):
        x, y, z = stars[k, 0], stars[k, 1], stars[k, 2]
        depth = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z
        if (depth < least) | (-x > 0.985 * _HORIZON):
            continue
        px = view[2] + view[0] * (rot[0, 0] * x + rot[0, 1] * y + rot[0, 2] * z) / depth - 0.5
        py = view[3] + view[1] * (rot[1, 0] * x + rot[1, 1] * y + rot[1, 2] * z) / depth - 0.5
        if px < 0.0 or py < 0.0 or px >= width - 1.0 or py >= height - 1.0:
            continue
        out[n, 0], out[n, 1] = px, py
        out[n, 2], out[n, 3], out[n, 4] = stars[k, 3], stars[k, 4], stars[k, 5]
        n += 1
    return n


@jit(nogil=True)
def paint_stars(found, n, row0, row1, width, sky, gain, colour):
    """Spread each star over the four pixels around it, where the sky is clear."""
    for k in range(n):
        px, py = found[k, 0], found[k, 1]
        if py < row0 - 1.0 or py >= row1:
            continue
        j, i = int(px), math.floor(py)
        fu, fv = np.float32(px - j), np.float32(py - i)
        for a in range(2):
            row = i + a - row0
            if row < 0 or row >= row1 - row0:
                continue
            for b in range(2):
                weight = (fv if a else np.float32(1.0) - fv) * (fu if b else np.float32(1.0) - fu)
                p = row * width + j + b
                weight *= sky[p] * gain
                colour[3 * p] += weight * np.float32(found[k, 2])
                colour[3 * p + 1] += weight * np.float32(found[k, 3])
                colour[3 * p + 2] += weight * np.float32(found[k, 4])
