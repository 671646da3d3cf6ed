"""Surface patterns, tileable, 256 texels a side: shade, second colour, and bumps, packed into bytes with mip levels.

Byte 0 is the shade (128 = as the material's colour), byte 1 the share of the material's second colour, bytes 2 and 3
the slopes along u and v (128 = flat). ``lerobot_spacedock.station.materials`` names the patterns.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.station.materials import PATTERNS

from .kernels_resolve import LEVELS, PATTERN_TEXELS, TILE


class Canvas:
    """One pattern in the making; u runs along columns, v along rows, both 0..1."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.Generator(np.random.PCG64(seed))
        self.shade = np.full((TILE, TILE), 0.5)
        self.second = np.zeros((TILE, TILE))
        self.height = np.zeros((TILE, TILE))  # in texels
        self.u, self.v = np.meshgrid((np.arange(TILE) + 0.5) / TILE, (np.arange(TILE) + 0.5) / TILE)

    def noise(self, cells: int, octaves: int = 4, stretch: tuple[int, int] = (1, 1)) -> np.ndarray:
        """Tileable value noise, about -1..1."""
        total, weight = np.zeros((TILE, TILE)), 1.0
        for _ in range(octaves):
            nu, nv = min(cells * stretch[0], TILE), min(cells * stretch[1], TILE)
            grid = self.rng.random((nv, nu)) * 2 - 1
            x, y = self.u * nu, self.v * nv
            ix, iy = np.floor(x).astype(int), np.floor(y).astype(int)
            fx, fy = x - ix, y - iy
            fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
            a, b = grid[iy % nv, ix % nu], grid[iy % nv, (ix + 1) % nu]
            c, d = grid[(iy + 1) % nv, ix % nu], grid[(iy + 1) % nv, (ix + 1) % nu]
            total += weight * ((a * (1 - fx) + b * fx) * (1 - fy) + (c * (1 - fx) + d * fx) * fy)
            weight *= 0.5
            cells *= 2
        return total

    def creases(self, count: int) -> np.ndarray:
        """Random facets, as crumpled film has: distance to the nearest of scattered points, less the second."""
        points = self.rng.random((count, 2))
        best = np.full((TILE, TILE), 9.0)
        second = best.copy()
        for px, py in points:
            dx, dy = np.abs(self.u - px), np.abs(self.v - py)
            d = np.sqrt(np.minimum(dx, 1 - dx) ** 2 + np.minimum(dy, 1 - dy) ** 2)
            second = np.where(d < best, best, np.minimum(second, d))
            best = np.minimum(best, d)
        return (second - best) * np.sqrt(count)

    def line(self, t: np.ndarray, at: float, width_texels: float) -> np.ndarray:
        """0..1 where a line runs at t = ``at`` (mod 1)."""
        d = np.abs((t - at + 0.5) % 1.0 - 0.5) * TILE
        return np.clip(0.5 * width_texels + 0.5 - d, 0.0, 1.0)

    def grid(self, nu: int, nv: int, width_texels: float) -> np.ndarray:
        """0..1 on the lines of a grid of nu by nv cells."""
        out = np.zeros((TILE, TILE))
        for t, n in ((self.u, nu), (self.v, nv)):
            d = np.abs((t * n + 0.5) % 1.0 - 0.5) * TILE / n if n else np.full_like(t, 99.0)
            out = np.maximum(out, np.clip(0.5 * width_texels + 0.5 - d, 0.0, 1.0))
        return out

    def dots(self, nu: int, nv: int, radius_texels: float, du: float = 0.5, dv: float = 0.5) -> np.ndarray:
        """0..1 on a lattice of dots."""
        x = ((self.u * nu + du) % 1.0 - 0.5) * TILE / nu
        y = ((self.v * nv + dv) % 1.0 - 0.5) * TILE / nv
        return np.clip(radius_texels + 0.5 - np.sqrt(x * x + y * y), 0.0, 1.0)

    def patches(self, nu: int, nv: int) -> np.ndarray:
        """A random level, -1..1, for each cell of a grid."""
        cell = self.rng.random((nv, nu)) * 2 - 1
        return cell[np.minimum((self.v * nv).astype(int), nv - 1), np.minimum((self.u * nu).astype(int), nu - 1)]


def _plain(c: Canvas) -> None:
    c.shade += 0.03 * c.noise(4, 5)
    c.height += 0.12 * c.noise(16, 3)


def _whipple(c: Canvas) -> None:
    """Debris-shield panels: two by two metres of sheets with seams and fasteners."""
    seam = c.grid(2, 2, 2.2)
    c.shade += 0.02 * c.noise(3, 5) + 0.035 * c.patches(2, 2) - 0.22 * seam
    rim = c.grid(2, 2, 16.0) - c.grid(2, 2, 12.0)
    bolts = np.maximum(c.dots(16, 2, 1.4, 0.0, 0.44), c.dots(2, 16, 1.4, 0.44, 0.0))
    bolts = np.maximum(bolts, np.maximum(c.dots(16, 2, 1.4, 0.0, 0.56), c.dots(2, 16, 1.4, 0.56, 0.0)))
    c.shade -= 0.13 * bolts + 0.015 * np.abs(rim)
    c.height += 0.25 * c.noise(6, 4) - 1.6 * seam + 0.5 * bolts


def _blanket(c: Canvas) -> None:
    """White quilted insulation: soft pillows, wrinkles, stitched seams, button ties."""
    seam = c.grid(2, 2, 2.0)
    pillow = np.abs(np.sin(2 * np.pi * c.u)) ** 0.5 * np.abs(np.sin(2 * np.pi * c.v)) ** 0.5
    wrinkle = c.noise(7, 4) + 0.6 * c.creases(60)
    ties = c.dots(4, 4, 1.6)
    c.shade += 0.03 * c.noise(3, 4) + 0.045 * c.noise(10, 3) - 0.12 * seam - 0.10 * ties + 0.03 * c.patches(2, 2)
    c.height += 3.0 * pillow + 1.9 * wrinkle - 1.2 * ties


def _crinkle(c: Canvas) -> None:
    """Crumpled metallised film."""
    facets = c.creases(110)
    c.shade += 0.05 * c.noise(6, 4)
    c.height += 4.5 * facets + 2.0 * c.noise(8, 4)
    c.second += np.clip(0.25 + 0.3 * c.noise(3, 3), 0, 1)


def _straps(c: Canvas) -> None:
    """Russian insulation: grey-green cloth in strips, held by straps and lacing."""
    seam = c.grid(2, 3, 2.0)
    strap = c.line(c.v, 0.17, 7.0) + c.line(c.v, 0.67, 7.0)
    wrinkle = c.noise(9, 4, (1, 2)) + 0.7 * c.creases(80)
    lace = c.dots(24, 3, 1.2, 0.5, 0.06)
    c.shade += 0.05 * c.noise(4, 4) + 0.05 * c.patches(2, 3) - 0.16 * seam - 0.14 * lace + 0.07 * strap
    c.second += 0.55 * strap
    c.height += 2.2 * wrinkle - 1.4 * seam + 1.0 * strap


def _cells_us(c: Canvas) -> None:
    """Silicon cells of 8 cm on Kapton: 12 across a tile, pale gaps, interconnects, hinge lines."""
    gap = c.grid(12, 12, 0.9)
    fine = c.grid(24, 0, 0.7) * 0.4
    corner = c.dots(12, 12, 2.2, 0.0, 0.0)
    hinge = c.grid(0, 2, 3.0)
    c.second += np.clip(gap * 0.35 + 0.9 * corner + 0.8 * hinge, 0, 1)
    c.shade += 0.10 * c.patches(12, 12) + 0.08 * c.patches(3, 2) + 0.03 * fine
    c.height += 0.35 * c.noise(3, 3)


def _cells_ru(c: Canvas) -> None:
    """Russian panels: small cells, dark frames every half tile."""
    gap = c.grid(16, 16, 1.2)
    frame = c.grid(2, 1, 5.0)
    c.second += np.clip(0.5 * gap, 0, 1)
    c.shade += 0.09 * c.patches(16, 16) + 0.06 * c.patches(4, 4) - 0.3 * frame
    c.height += 0.3 * c.noise(3, 3)


def _kapton_back(c: Canvas) -> None:
    """The back of an array blanket: amber film with the cells' shadows and hinges."""
    c.second += np.clip(0.8 * c.grid(12, 12, 2.0) + c.grid(0, 2, 4.0), 0, 1)
    c.shade += 0.05 * c.patches(12, 12) + 0.04 * c.noise(4, 4)


def _radiator(c: Canvas) -> None:
    """White panels with flow tubes under the skin."""
    c.shade += -0.07 * c.grid(16, 0, 1.4) - 0.16 * c.grid(0, 1, 3.0) - 0.2 * c.grid(1, 0, 4.0) + 0.02 * c.noise(4, 4)
    c.height += 0.8 * c.grid(16, 0, 4.0)


def _machined(c: Canvas) -> None:
    """Bare metal: fine turning marks, stains, rivet rows."""
    c.shade += (
        0.04 * c.noise(2, 3) + 0.035 * c.noise(2, 2, (1, 32)) - 0.12 * c.dots(12, 2, 1.5) - 0.1 * c.grid(1, 1, 1.6)
    )
    c.height += 0.35 * c.noise(2, 2, (1, 40)) + 0.6 * c.dots(12, 2, 2.0)


def _weave(c: Canvas) -> None:
    """Dark cloth or tiles: a regular grid with slight relief."""
    c.shade += 0.07 * c.patches(8, 8) - 0.25 * c.grid(8, 8, 2.0) + 0.04 * c.noise(8, 4)
    c.height += -1.0 * c.grid(8, 8, 3.0) + 0.4 * c.noise(8, 3)


def _stripes(c: Canvas) -> None:
    """Diagonal warning stripes of the second colour."""
    c.second += np.clip(((c.u * 4 + c.v * 4) % 1.0 - 0.5) * 200 + 0.5, 0, 1)
    c.shade += 0.03 * c.noise(6, 4)


_PAINTERS = {
    "plain": _plain,
    "whipple": _whipple,
    "blanket": _blanket,
    "crinkle": _crinkle,
    "straps": _straps,
    "cells_us": _cells_us,
    "cells_ru": _cells_ru,
    "kapton_back": _kapton_back,
    "radiator": _radiator,
    "machined": _machined,
    "weave": _weave,
    "stripes": _stripes,
}


def make_patterns() -> np.ndarray:
    """Every pattern with its mip levels, in the order of ``PATTERNS``, flat uint32; the level of side s is at s²."""
    out = np.zeros(len(PATTERNS) * PATTERN_TEXELS, np.uint32)
    for number, name in enumerate(PATTERNS):
        canvas = Canvas(1000 + number)
        _PAINTERS[name](canvas)
        slope_u = 0.5 * (np.roll(canvas.height, -1, 1) - np.roll(canvas.height, 1, 1))
        slope_v = 0.5 * (np.roll(canvas.height, -1, 0) - np.roll(canvas.height, 1, 0))
        layers = [canvas.shade, canvas.second, slope_u * 0.25 + 128 / 255, slope_v * 0.25 + 128 / 255]
        for _level in range(LEVELS):
            packed = np.zeros(layers[0].shape, np.uint32)
            for place, layer in enumerate(layers):
                # rounded twice, so that a last-digit difference between machines cannot reach a byte
                byte = np.floor(np.round(np.clip(layer, 0, 1) * 255.0, 4) + 0.5).astype(np.uint32)
                packed |= byte << np.uint32(8 * place)
            packed = np.concatenate([packed, packed[:, :1]], axis=1)
            start = number * PATTERN_TEXELS + packed.size
            out[start : start + packed.size] = packed.ravel()
            layers = [0.25 * (a[::2, ::2] + a[1::2, ::2] + a[::2, 1::2] + a[1::2, 1::2]) for a in layers]
    return out.view(np.int32)  # the kernels read signed words: unsigned ones convert to float slowly
