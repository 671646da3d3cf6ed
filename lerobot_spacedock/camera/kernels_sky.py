"""What is behind the station: Earth with clouds and limb, the Sun's disc, and stars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lerobot_spacedock.physics.constants import EARTH_EQUATORIAL_RADIUS_m, ORBIT_RADIUS_m

from .kernels_raster import JIT

EARTH_SIZE = 2048  # texels along the side of the Earth patch that is seen from orbit
EARTH_REACH = 0.37  # sine of the central angle at the patch's edge; the horizon is at 0.342
_RO = ORBIT_RADIUS_m / EARTH_EQUATORIAL_RADIUS_m  # everything below in Earth radii
_HORIZON = math.sqrt(1.0 - 1.0 / (_RO * _RO))  # cosine from the nadir of the geometric horizon


@njit(**JIT)
def paint_sky(row0, row1, width, sky, rot, view, light, earth, colour):
    """Add the sky's share to the band's pixels, tone-mapped like everything else."""
    one, zero = np.float32(1.0), np.float32(0.0)
    inv_fx, inv_fy = 1.0 / view[0], 1.0 / view[1]
    sx, sy, sz = light[0], light[1], light[2]
    exposure = light[15]
    # only the Sun's colour is used here; in the station's eclipse the Earth below may still be lit, so keep it white
    ro = np.float32(_RO)
    half = np.float32(0.5 * EARTH_SIZE)
    per = np.float32(0.5 * EARTH_SIZE / EARTH_REACH)
    limit = EARTH_SIZE - 2
    m8, byte = np.uint32(255), np.float32(1.0 / 255.0)
    for i in range(row1 - row0):
        dy = np.float32((row0 + i + 0.5 - view[3]) * inv_fy)
        for j in range(width):
            share = sky[i * width + j]
            if share == zero:
                continue
            dx = np.float32((j + 0.5 - view[2]) * inv_fx)
            rx = np.float32(rot[0, 0]) * dx + np.float32(rot[1, 0]) * dy + np.float32(rot[2, 0])
            ry = np.float32(rot[0, 1]) * dx + np.float32(rot[1, 1]) * dy + np.float32(rot[2, 1])
            rz = np.float32(rot[0, 2]) * dx + np.float32(rot[1, 2]) * dy + np.float32(rot[2, 2])
            inv = one / math.sqrt(rx * rx + ry * ry + rz * rz)
            rx, ry, rz = rx * inv, ry * inv, rz * inv
            red = green = blue = zero
            down = -rx
            gap = ro * ro * (one - down * down)  # squared distance of the ray from the Earth's centre
            if down > zero and gap < one:
                t = ro * down - math.sqrt(one - gap)
                nx, ny, nz = ro + t * rx, t * ry, t * rz
                u = ny * per + half
                v = nz * per + half
                iu = min(max(int(u), 0), limit)
                iv = min(max(int(v), 0), limit)
                fu, fv = u - np.float32(iu), v - np.float32(iv)
                p = iv * EARTH_SIZE + iu
                ta, tb, tc, td = earth[p], earth[p + 1], earth[p + EARTH_SIZE], earth[p + EARTH_SIZE + 1]
                wa, wb, wc, wd = (
                    (one - fu) * (one - fv) * byte,
                    fu * (one - fv) * byte,
                    (one - fu) * fv * byte,
                    fu * fv * byte,
                )
                gr = (
                    np.float32(ta & m8) * wa
                    + np.float32(tb & m8) * wb
                    + np.float32(tc & m8) * wc
                    + np.float32(td & m8) * wd
                )
                gg = (
                    np.float32((ta >> np.uint32(8)) & m8) * wa + np.float32((tb >> np.uint32(8)) & m8) * wb
                    + np.float32((tc >> np.uint32(8)) & m8) * wc + np.float32((td >> np.uint32(8)) & m8) * wd
                )  # fmt: skip
                gb = (
                    np.float32((ta >> np.uint32(16)) & m8) * wa + np.float32((tb >> np.uint32(16)) & m8) * wb
                    + np.float32((tc >> np.uint32(16)) & m8) * wc + np.float32((td >> np.uint32(16)) & m8) * wd
                )  # fmt: skip
                gloss = (
                    np.float32(ta >> np.uint32(24)) * wa + np.float32(tb >> np.uint32(24)) * wb
                    + np.float32(tc >> np.uint32(24)) * wc + np.float32(td >> np.uint32(24)) * wd
                )  # fmt: skip
                mu = max(-(rx * nx + ry * ny + rz * nz), zero)
                sun = nx * sx + ny * sy + nz * sz
                day = min(max((sun + np.float32(0.06)) * np.float32(5.0), zero), one)
                day = day * day
                level = day * max(sun, np.float32(0.02))
                # Sun glint on water, broad because of waves
                hx, hy, hz = sx - rx, sy - ry, sz - rz
                hh = one / math.sqrt(hx * hx + hy * hy + hz * hz + np.float32(1e-6))
                nh = max((nx * hx + ny * hy + nz * hz) * hh, zero)
                nh = nh * nh
                nh = nh * nh
                nh = nh * nh
                nh = nh * nh
                nh = nh * nh
                glint = gloss * nh * nh * day * np.float32(0.6)
                warm = min(max(np.float32(0.25) - sun, zero) * np.float32(3.0), one)  # low Sun reddens
                haze = np.float32(0.05) / (np.float32(0.05) + mu)
                keep = one - haze
                red = keep * (gr * level + glint) + haze * np.float32(0.30) * level * (one + warm)
                green = keep * (gg * level * (one - np.float32(0.25) * warm) + glint) + haze * np.float32(0.46) * level
                blue = keep * (gb * level * (one - np.float32(0.45) * warm) + glint) + haze * np.float32(
                    0.80
                ) * level * (one - np.float32(0.4) * warm)
            else:
                if down > zero:
                    # thin shells of air above the limb: heights in units of 10 km
                    h = (math.sqrt(gap) - one) * np.float32(637.8)
                    if h < np.float32(14.0):
                        nx = ro + ro * down * rx
                        sun = (nx * sx + ro * down * (ry * sy + rz * sz)) / math.sqrt(gap)
                        day = min(max((sun + np.float32(0.12)) * np.float32(4.0), zero), one)
                        level = day * min(max(sun, np.float32(0.03)) + np.float32(0.1), one)
                        low = one / (one + h * (one + h * (np.float32(0.5) + h * np.float32(0.1666))))
                        h2 = h * np.float32(0.45)
                        high = one / (one + h2 * (one + h2 * (np.float32(0.5) + h2 * np.float32(0.1666))))
                        warm = min(max(np.float32(0.2) - sun, zero) * np.float32(4.0), one)
                        red = level * (np.float32(0.45) * low * (one + warm) + np.float32(0.02) * high)
                        green = level * (np.float32(0.55) * low + np.float32(0.10) * high)
                        blue = level * (
                            np.float32(0.65) * low * (one - np.float32(0.6) * warm) + np.float32(0.35) * high
                        )
                        glow = h * np.float32(0.1) - np.float32(0.95)  # green airglow, a thin layer near 95 km
                        night = np.float32(0.004) / (one + np.float32(60.0) * glow * glow)
                        red += night * np.float32(0.4)
                        green += night
                        blue += night * np.float32(0.3)
                away = one - (rx * sx + ry * sy + rz * sz)
                if away < np.float32(0.02):
                    flare = (
                        np.float32(6e-6) / (away + np.float32(2e-6)) if away > np.float32(1.1e-5) else np.float32(40.0)
                    )
                    red += flare
                    green += flare * np.float32(0.97)
                    blue += flare * np.float32(0.9)
            p = 3 * (i * width + j)
            x = red * exposure
            colour[p] += share * (
                x
                * (np.float32(2.51) * x + np.float32(0.03))
                / (x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14))
            )
            x = green * exposure
            colour[p + 1] += share * (
                x
                * (np.float32(2.51) * x + np.float32(0.03))
                / (x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14))
            )
            x = blue * exposure
            colour[p + 2] += share * (
                x
                * (np.float32(2.51) * x + np.float32(0.03))
                / (x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14))
            )


@njit(**JIT)
def project_stars(stars, rot, view, width, height, out):
    """Stars in the picture and above the air → rows of (column, row, red, green, blue); their number."""
    n = 0
    for k in range(stars.shape[0]):
        x, y, z = stars[k, 0], stars[k, 1], stars[k, 2]
        depth = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z
        if depth <= 1e-3 or -x > 0.985 * _HORIZON:
            continue
        px = view[2] + view[0] * (rot[0, 0] * x + rot[0, 1] * y + rot[0, 2] * z) / depth - 0.5
        py = view[3] + view[1] * (rot[1, 0] * x + rot[1, 1] * y + rot[1, 2] * z) / depth - 0.5
        if px < 0.0 or py < 0.0 or px >= width - 1.0 or py >= height - 1.0:
            continue
        out[n, 0], out[n, 1] = px, py
        out[n, 2], out[n, 3], out[n, 4] = stars[k, 3], stars[k, 4], stars[k, 5]
        n += 1
    return n


@njit(**JIT)
def paint_stars(found, n, row0, row1, width, sky, gain, colour):
    """Spread each star over the four pixels around it, where the sky is clear."""
    for k in range(n):
        px, py = found[k, 0], found[k, 1]
        if py < row0 - 1.0 or py >= row1:
            continue
        j, i = int(px), int(math.floor(py))
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
