"""Shadow maps: the scene's nearest depth towards the Sun, drawn once for each Sun and shared by every renderer."""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

FAR_BELOW = np.float32(-1e9)


@jit(nogil=True)
def draw_depth(corners, basis, offset_u, offset_v, texels_per_m, size, ramp, out):
    """Draw all triangles, orthographically along the Sun's direction.

    Args:
        corners: (F, 9) float32 m.
        basis: (3, 3) float64; rows are the map's u and v axes and the direction towards the Sun.
        offset_u, offset_v: m, map coordinates of texel corner (0, 0).
        texels_per_m: 1/m.
        size: texels along each side.
        ramp: float32; 0, 1, 2 … up to the size at least.
        out: (size*size,) float32, filled with the largest height towards the Sun, m.
    """
    out[:] = FAR_BELOW
    limit = float(size)
    for f in range(corners.shape[0]):
        ax = (
            basis[0, 0] * corners[f, 0] + basis[0, 1] * corners[f, 1] + basis[0, 2] * corners[f, 2] - offset_u
        ) * texels_per_m
        bx = (
            basis[0, 0] * corners[f, 3] + basis[0, 1] * corners[f, 4] + basis[0, 2] * corners[f, 5] - offset_u
        ) * texels_per_m
        cx = (
            basis[0, 0] * corners[f, 6] + basis[0, 1] * corners[f, 7] + basis[0, 2] * corners[f, 8] - offset_u
        ) * texels_per_m
        if max(ax, bx, cx) <= 0.0 or min(ax, bx, cx) >= limit:
            continue
        ay = (
            basis[1, 0] * corners[f, 0] + basis[1, 1] * corners[f, 1] + basis[1, 2] * corners[f, 2] - offset_v
        ) * texels_per_m
        by = (
            basis[1, 0] * corners[f, 3] + basis[1, 1] * corners[f, 4] + basis[1, 2] * corners[f, 5] - offset_v
        ) * texels_per_m
        cy = (
            basis[1, 0] * corners[f, 6] + basis[1, 1] * corners[f, 7] + basis[1, 2] * corners[f, 8] - offset_v
        ) * texels_per_m
        if max(ay, by, cy) <= 0.0 or min(ay, by, cy) >= limit:
            continue
        ah = basis[2, 0] * corners[f, 0] + basis[2, 1] * corners[f, 1] + basis[2, 2] * corners[f, 2]
        bh = basis[2, 0] * corners[f, 3] + basis[2, 1] * corners[f, 4] + basis[2, 2] * corners[f, 5]
        ch = basis[2, 0] * corners[f, 6] + basis[2, 1] * corners[f, 7] + basis[2, 2] * corners[f, 8]
        if ay > by:
            ax, ay, ah, bx, by, bh = bx, by, bh, ax, ay, ah
        if by > cy:
            bx, by, bh, cx, cy, ch = cx, cy, ch, bx, by, bh
        if ay > by:
            ax, ay, ah, bx, by, bh = bx, by, bh, ax, ay, ah
        det = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if not abs(det) > 1e-9:
            continue
        gx = ((bh - ah) * (cy - ay) - (ch - ah) * (by - ay)) / det
        gy = ((ch - ah) * (bx - ax) - (bh - ah) * (cx - ax)) / det
        # a steep face's plane may run far past its own corners between texel centres
        low, high = np.float32(min(ah, bh, ch)), np.float32(max(ah, bh, ch))
        k0 = max(math.ceil(max(ay - 0.5, -1.0)), 0)
        k1 = min(math.ceil(min(cy - 0.5, limit)), size)
        slope_ac = (cx - ax) / (cy - ay)
        slope_ab = (bx - ax) / (by - ay) if by > ay else 0.0
        slope_bc = (cx - bx) / (cy - by) if cy > by else 0.0
        for k in range(k0, k1):
            y = k + 0.5
            x0 = ax + (y - ay) * slope_ac
            x1 = ax + (y - ay) * slope_ab if y < by else bx + (y - by) * slope_bc
            if x0 > x1:
                x0, x1 = x1, x0
            j0 = math.ceil(min(max(x0 - 0.5, 0.0), limit))
            j1 = math.ceil(min(max(x1 - 0.5, 0.0), limit))
            if j0 >= j1:
                continue
            h0, step = np.float32(ah + gx * (j0 + 0.5 - ax) + gy * (y - ay)), np.float32(gx)
            p = np.uint64(k * size + j0)
            for j in range(np.uint64(j1 - j0)):
                h = min(max(h0 + step * ramp[j], low), high)
                old = out[p + j]
                keep = np.float32(h > old)  # arithmetic, because a masked store is slow on some CPUs
                out[p + j] = keep * h + (np.float32(1.0) - keep) * old
