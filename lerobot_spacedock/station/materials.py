"""What the station is made of: colours in linear light, gloss, and the pattern that covers it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PATTERNS = (
    "plain", "whipple", "blanket", "crinkle", "straps", "cells_us", "cells_ru", "kapton_back", "radiator", "machined",
    "weave", "stripes",
)  # fmt: skip


@dataclass(frozen=True)
class Material:
    """One surface.

    Args:
        name: unique.
        base: linear reflectance, red, green, blue.
        second: the pattern's other colour.
        rough: 0 mirror to 1 chalk.
        f0: reflectance at normal incidence where not metal.
        metal: 1 where the base colour is the mirror's colour.
        pattern: one of PATTERNS.
        tile_m: m covered by one tile of the pattern; 0 for no pattern.
        bump: strength of the pattern's relief.
        glow: light given off, in units of white paper in sunlight after exposure.
        tint: strength of the pattern's shading.
    """

    name: str
    base: tuple[float, float, float]
    second: tuple[float, float, float] = (0.5, 0.5, 0.5)
    rough: float = 0.6
    f0: float = 0.04
    metal: float = 0.0
    pattern: str = "plain"
    tile_m: float = 1.5
    bump: float = 1.0
    glow: float = 0.0
    tint: float = 1.0

    def row(self) -> list[float]:
        """The 14 numbers of the renderer's material table."""
        scale = 1.0 / self.tile_m if self.tile_m else 0.0
        return [*self.base, *self.second, self.rough, self.f0, self.metal, scale, self.bump,
                float(PATTERNS.index(self.pattern)), self.glow, self.tint]  # fmt: skip


MATERIALS = (
    Material("white_shield", (0.56, 0.56, 0.545), rough=0.5, pattern="whipple", tile_m=2.2, tint=1.5, bump=1.3),
    Material("beta_cloth", (0.62, 0.61, 0.58), rough=0.75, pattern="blanket", tile_m=1.1, bump=1.7, tint=1.3),
    Material(
        "russian_mli", (0.40, 0.405, 0.36), (0.55, 0.54, 0.48), rough=0.65, pattern="straps", tile_m=1.3, bump=1.6
    ),
    Material(
        "russian_white", (0.58, 0.585, 0.55), (0.66, 0.65, 0.6), rough=0.65, pattern="straps", tile_m=1.6, bump=1.3
    ),
    Material(
        "gold_mli",
        (0.90, 0.62, 0.26),
        (0.80, 0.48, 0.16),
        rough=0.32,
        metal=1.0,
        pattern="crinkle",
        tile_m=0.8,
        bump=1.6,
    ),
    Material(
        "silver_mli",
        (0.78, 0.77, 0.74),
        (0.6, 0.6, 0.6),
        rough=0.33,
        metal=0.85,
        pattern="crinkle",
        tile_m=0.7,
        bump=1.5,
    ),
    Material("dark_mli", (0.035, 0.035, 0.038), (0.06, 0.06, 0.06), rough=0.5, pattern="blanket", tile_m=0.8, bump=1.3),
    Material("aluminium", (0.62, 0.62, 0.62), rough=0.42, metal=0.8, pattern="machined", tile_m=0.9),
    Material("anodised", (0.46, 0.46, 0.45), rough=0.5, metal=0.4, pattern="machined", tile_m=0.6),
    Material("dark_metal", (0.075, 0.075, 0.08), rough=0.45, f0=0.05, metal=0.2, pattern="machined", tile_m=0.5),
    Material("black", (0.012, 0.012, 0.013), rough=0.7, tile_m=0.5),
    Material("white_paint", (0.66, 0.66, 0.65), rough=0.5, tile_m=0.8),
    Material("handrail", (0.72, 0.50, 0.13), rough=0.45, metal=0.25, tile_m=0.3),
    Material(
        "cells_us",
        (0.013, 0.019, 0.050),
        (0.30, 0.17, 0.065),
        rough=0.18,
        f0=0.06,
        pattern="cells_us",
        tile_m=0.96,
        bump=0.5,
        tint=1.4,
    ),
    Material(
        "cells_ru",
        (0.020, 0.026, 0.055),
        (0.12, 0.12, 0.13),
        rough=0.2,
        f0=0.06,
        pattern="cells_ru",
        tile_m=1.1,
        bump=0.5,
    ),
    Material(
        "kapton_back", (0.40, 0.225, 0.075), (0.20, 0.11, 0.04), rough=0.4, f0=0.06, pattern="kapton_back", tile_m=0.96
    ),
    Material("radiator", (0.70, 0.70, 0.69), rough=0.35, pattern="radiator", tile_m=1.1, bump=0.8),
    Material("window", (0.015, 0.02, 0.025), rough=0.06, f0=0.09, tile_m=0.0),
    Material("red", (0.42, 0.03, 0.025), rough=0.6, tile_m=0.5),
    Material("blue", (0.03, 0.06, 0.24), rough=0.6, tile_m=0.5),
    Material("orange", (0.62, 0.22, 0.04), rough=0.6, tile_m=0.5),
    Material("stripes", (0.62, 0.44, 0.03), (0.015, 0.015, 0.015), rough=0.6, pattern="stripes", tile_m=0.25),
    Material("copper", (0.62, 0.34, 0.20), rough=0.38, metal=0.9, pattern="machined", tile_m=0.4),
    Material("machined_ring", (0.66, 0.65, 0.63), rough=0.36, metal=0.75, pattern="machined", tile_m=0.35, bump=0.7),
    Material("drogue", (0.57, 0.57, 0.56), rough=0.4, metal=0.6, pattern="machined", tile_m=0.25, bump=0.6),
    Material("tile_dark", (0.05, 0.05, 0.052), rough=0.75, pattern="weave", tile_m=1.0),
    Material("soyuz_green", (0.17, 0.19, 0.15), (0.24, 0.25, 0.2), rough=0.7, pattern="straps", tile_m=0.9, bump=1.6),
    Material("target_white", (0.84, 0.84, 0.83), rough=0.8, tile_m=0.0),
    Material("target_black", (0.010, 0.010, 0.011), rough=0.85, tile_m=0.0),
    Material("reflector", (0.55, 0.62, 0.66), rough=0.15, metal=0.7, pattern="weave", tile_m=0.12, bump=0.5),
    Material("tan_cloth", (0.50, 0.44, 0.34), (0.58, 0.52, 0.42), rough=0.75, pattern="blanket", tile_m=0.9, bump=1.4),
    Material("user", (0.55, 0.55, 0.55), rough=0.55, tile_m=0.0),
    Material("lamp_red", (1.0, 0.05, 0.03), rough=0.5, tile_m=0.0, glow=0.6),
    Material("lamp_green", (0.05, 1.0, 0.15), rough=0.5, tile_m=0.0, glow=0.6),
)

MATERIAL_INDEX = {m.name: i for i, m in enumerate(MATERIALS)}


def srgb_bytes(linear: np.ndarray) -> np.ndarray:
    """Linear light, 0 to 1 and clipped to it → sRGB (IEC 61966-2-1), uint8 of the same shape."""
    linear = np.clip(linear, 0.0, 1.0)
    curved = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (curved * 255.0 + 0.5).astype(np.uint8)
