"""Light: turn located fragments into colour, a chunk at a time (deferred shading).

Memory is read in short scalar loops that leave many reads under way at once; all arithmetic is in loops that LLVM
vectorises: one scratch array, strides known at compile time, no calls, no libm.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import inner, jit

from .kernels_fetch import load_pair
from .kernels_resolve import (
    AB,
    AG,
    AO,
    AR,
    BUMP,
    DIST,
    EMIT,
    F0,
    FOOT,
    FU,
    FV,
    HIGH,
    METAL,
    NX,
    NY,
    NZ,
    PATTERN,
    ROUGH,
    SB,
    SG,
    SHADOW_TILE_U,
    SR,
    STRIDE,
    SUN,
    TEXEL,
    TINT,
    TU,
    TV,
    UX,
    UY,
    UZ,
    VX,
    VY,
    VZ,
    WX,
    WY,
    WZ,
)

# places in the light array: Sun direction, Sun colour, Earth colour, fill colour, lamp, exposure
SUN_DIR, SUN_RGB, EARTH_RGB, FILL_RGB, LAMP_RGB, EXPOSURE, LAMP_SOFT_m2, LAMP_ON = 0, 3, 6, 9, 12, 15, 16, 17
LIGHT_SIZE = 18


@inner
def shade_shadow(n, light, maps, s, taps):
    """Share of the Sun that reaches n fragments (0..1): four texels of the map, bilinear."""
    one, zero = np.float32(1.0), np.float32(0.0)
    low_half, sixteen = np.int32(0xFFFF), np.int32(16)
    if maps.shape[0] == 0 or light[3] <= zero:
        s[SUN * STRIDE : SUN * STRIDE + n] = one if light[3] > zero else zero
        return
    for k in range(np.uint64(n)):
        p = np.uint64(s[TEXEL * STRIDE + k])
        q = p + np.uint64(SHADOW_TILE_U + 1)
        taps[k], taps[STRIDE + k] = load_pair(maps, p, np.int32), load_pair(maps, q, np.int32)
    for k in range(np.uint64(n)):
        h, fu, fv = s[HIGH * STRIDE + k], s[FU * STRIDE + k], s[FV * STRIDE + k]
        upper, lower = taps[k], taps[STRIDE + k]
        a = zero if np.float32(np.int32(upper & low_half)) > h else one
        b = zero if np.float32(np.int32((upper >> sixteen) & low_half)) > h else one
        d = zero if np.float32(np.int32(lower & low_half)) > h else one
        e = zero if np.float32(np.int32((lower >> sixteen) & low_half)) > h else one
        top = a + fu * (b - a)
        low = d + fu * (e - d)
        s[SUN * STRIDE + k] = top + fv * (low - top)


@inner
def clothe(n, texels, s, taps):
    """Colour and relief of n fragments from their material's pattern, bilinear in the nearest mip level."""
    f32, i32 = np.float32, np.int32
    one, zero = f32(1.0), f32(0.0)
    for k in range(np.uint64(n)):
        # the level is the power of two above the footprint, which is in the float's exponent
        bits = i32(f32(s[FOOT * STRIDE + k] * f32(2.0 / 3.0)).view(i32))
        level = min(max(i32((bits - i32(1)) >> i32(23)) - i32(126), i32(0)), i32(8))
        side = i32(256) >> i32(level)
        wide = f32(side)
        u, v = s[TU * STRIDE + k], s[TV * STRIDE + k]
        u, v = (u - np.floor(u)) * wide, (v - np.floor(v)) * wide
        iu, iv = i32(u), i32(v)
        s[FU * STRIDE + k], s[FV * STRIDE + k] = u - f32(iu), v - f32(iv)
        s[BUMP * STRIDE + k] = s[BUMP * STRIDE + k] if level < 5 else zero
        mask = i32(side - i32(1))
        first = i32(i32(s[PATTERN * STRIDE + k]) + i32(side * side))
        first += i32(side + (iu & mask))
        taps[k] = i32(first + (iv & mask) * (side + i32(1)))
        taps[2 * STRIDE + k] = i32(first + ((iv + i32(1)) & mask) * (side + i32(1)))
    for k in range(np.uint64(n)):
        upper = load_pair(texels, np.uint64(np.uint32(taps[k])), np.int64)
        lower = load_pair(texels, np.uint64(np.uint32(taps[2 * STRIDE + k])), np.int64)
        taps[k], taps[STRIDE + k] = i32(upper), i32(upper >> 32)
        taps[2 * STRIDE + k], taps[3 * STRIDE + k] = i32(lower), i32(lower >> 32)
    byte, middle, two = f32(1.0 / 255.0), f32(128.0 / 255.0), f32(2.0)
    for k in range(np.uint64(n)):
        ta, tb, tc, td = taps[k], taps[STRIDE + k], taps[2 * STRIDE + k], taps[3 * STRIDE + k]
        fu, fv = s[FU * STRIDE + k], s[FV * STRIDE + k]
        fu1, fv1 = (one - fu) * byte, one - fv
        fu = fu * byte
        wa, wb, wc, wd = fu1 * fv1, fu * fv1, fu1 * fv, fu * fv
        shade = f32(i32(ta & 255)) * wa + f32(i32(tb & 255)) * wb + f32(i32(tc & 255)) * wc + f32(i32(td & 255)) * wd
        second = (
            f32(i32((ta >> 8) & 255)) * wa + f32(i32((tb >> 8) & 255)) * wb
            + f32(i32((tc >> 8) & 255)) * wc + f32(i32((td >> 8) & 255)) * wd
        )  # fmt: skip
        bump_u = (
            f32(i32((ta >> 16) & 255)) * wa + f32(i32((tb >> 16) & 255)) * wb
            + f32(i32((tc >> 16) & 255)) * wc + f32(i32((td >> 16) & 255)) * wd
        )  # fmt: skip
        bump_v = (
            f32(i32((ta >> 24) & 255)) * wa + f32(i32((tb >> 24) & 255)) * wb
            + f32(i32((tc >> 24) & 255)) * wc + f32(i32((td >> 24) & 255)) * wd
        )  # fmt: skip
        bump = s[BUMP * STRIDE + k]
        bump_u, bump_v = (bump_u - middle) * bump, (bump_v - middle) * bump
        s[NX * STRIDE + k] -= bump_u * s[UX * STRIDE + k] + bump_v * s[WX * STRIDE + k]
        s[NY * STRIDE + k] -= bump_u * s[UY * STRIDE + k] + bump_v * s[WY * STRIDE + k]
        s[NZ * STRIDE + k] -= bump_u * s[UZ * STRIDE + k] + bump_v * s[WZ * STRIDE + k]
        has_pattern = one if s[TINT * STRIDE + k] > zero else zero
        tint = one + s[TINT * STRIDE + k] * (shade * two - one)
        second *= has_pattern
        s[AR * STRIDE + k] = (s[AR * STRIDE + k] + second * s[SR * STRIDE + k]) * tint
        s[AG * STRIDE + k] = (s[AG * STRIDE + k] + second * s[SG * STRIDE + k]) * tint
        s[AB * STRIDE + k] = (s[AB * STRIDE + k] + second * s[SB * STRIDE + k]) * tint


@inner(forceinline=True)
def film(x):
    """Film-like curve (a rational fit of the ACES reference curve)."""
    x = min(x, np.float32(60.0))
    return (
        x * (np.float32(2.51) * x + np.float32(0.03))
        / (x * (np.float32(2.43) * x + np.float32(0.59)) + np.float32(0.14))
    )  # fmt: skip


@inner
def lighten(n, light, s):
    """Light, expose and tone-map n fragments; their colours take the place of their reflectance."""
    lx, ly, lz = light[0], light[1], light[2]
    sr, sg, sb = light[3], light[4], light[5]
    er, eg, eb = light[6], light[7], light[8]
    ar, ag, ab = light[9], light[10], light[11]
    pr, pg, pb = light[12], light[13], light[14]
    exposure, soft = light[15], light[16]
    one, zero, half = np.float32(1.0), np.float32(0.0), np.float32(0.5)
    tiny = np.float32(1e-6)
    for k in range(np.uint64(n)):
        nx, ny, nz = s[NX * STRIDE + k], s[NY * STRIDE + k], s[NZ * STRIDE + k]
        inv = one / math.sqrt(nx * nx + ny * ny + nz * nz + tiny)
        nx, ny, nz = nx * inv, ny * inv, nz * inv
        vx, vy, vz = s[VX * STRIDE + k], s[VY * STRIDE + k], s[VZ * STRIDE + k]
        f0, metal, rough = s[F0 * STRIDE + k], s[METAL * STRIDE + k], s[ROUGH * STRIDE + k]
        cr, cg, cb = s[AR * STRIDE + k], s[AG * STRIDE + k], s[AB * STRIDE + k]
        ao, lit = s[AO * STRIDE + k], s[SUN * STRIDE + k]
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
        dist = s[DIST * STRIDE + k]
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
        glow = s[EMIT * STRIDE + k]
        red = dull * cr * (sr * diff + er * earth + ar * ao + pr * lamp) + er_ * er * env + fr * pr * spec_lamp
        green = dull * cg * (sg * diff + eg * earth + ag * ao + pg * lamp) + eg_ * eg * env + fg * pg * spec_lamp
        blue = dull * cb * (sb * diff + eb * earth + ab * ao + pb * lamp) + eb_ * eb * env + fb * pb * spec_lamp
        red = (red + sr * spec * (fr + (one - fr) * fresnel) + metal * cr * ar * ao) * exposure + glow * cr
        green = (green + sg * spec * (fg + (one - fg) * fresnel) + metal * cg * ag * ao) * exposure + glow * cg
        blue = (blue + sb * spec * (fb + (one - fb) * fresnel) + metal * cb * ab * ao) * exposure + glow * cb
        s[AR * STRIDE + k], s[AG * STRIDE + k], s[AB * STRIDE + k] = film(red), film(green), film(blue)


@inner
def deposit(first, n, frag_pixel, frag_weight, s, colour):
    """Add n fragments' colours to their pixels."""
    for k in range(np.uint64(n)):
        p = np.uint64(3) * np.uint64(frag_pixel[np.uint64(first) + k])
        w = frag_weight[np.uint64(first) + k]
        colour[p] += w * s[AR * STRIDE + k]
        colour[p + np.uint64(1)] += w * s[AG * STRIDE + k]
        colour[p + np.uint64(2)] += w * s[AB * STRIDE + k]


@jit(nogil=True)
def encode(colour, n, out, start):
    """Linear 0..1 → sRGB bytes, the power replaced by a polynomial in the square root (within 1/12 grey level)."""
    f32 = np.float32
    one, zero = f32(1.0), f32(0.0)
    shown = out[start : start + n]
    for k in range(np.uint64(n)):
        x = min(max(colour[k], zero), one)
        a = math.sqrt(x)
        y = f32(0.51699025) * a - f32(1.62269578)
        y = ((y * a + f32(2.03050909)) * a - f32(1.40222151)) * a
        y = (y + f32(1.51784695)) * a - f32(0.04010306)
        y = f32(12.92) * x if x < f32(0.0031308) else y
        shown[k] = np.uint8(np.int32(y * f32(255.0) + f32(0.5)))  # y leaves 0 .. 1 by rounding only
