"""Collects patches with their material and segment while the station is put together, and dresses surfaces."""

from __future__ import annotations

import numpy as np

from .materials import MATERIAL_INDEX
from .shapes import Patch, box, cylinder, disc, join, place, pose, revolve, strut, torus, tube, turn

SEGMENTS = (
    "sky", "zvezda", "zvezda_port", "zarya", "poisk", "nauka", "prichal", "rassvet", "unity", "destiny", "harmony",
    "columbus", "kibo", "tranquility", "cupola", "leonardo", "beam", "quest", "pma", "harmony_port", "truss", "arrays",
    "radiators", "canadarm2", "soyuz", "progress", "dragon", "user",
)  # fmt: skip
SEGMENT_INDEX = {name: i for i, name in enumerate(SEGMENTS)}


class Builder:
    """Grows a station in station axes.

    Args:
        high: build the finer level of detail.
    """

    def __init__(self, high: bool) -> None:
        self.high = high
        self.segment = "zvezda"
        self.rng = np.random.Generator(np.random.PCG64(7))  # scatter of small parts, the same for both levels
        self._parts: list[tuple[Patch, int, int]] = []

    def add(self, patch: Patch, material: str, *poses: np.ndarray) -> None:
        """Add a patch, moved by the product of ``poses``."""
        if poses:
            total = poses[0]
            for p in poses[1:]:
                total = total @ p
            patch = place(patch, total)
        self._parts.append((patch, MATERIAL_INDEX[material], SEGMENT_INDEX[self.segment]))

    def sides(self, radius: float) -> int:
        """Facets for a round part of this radius, m."""
        steps = ((1.2, 22, 56), (0.7, 14, 36), (0.3, 10, 22), (0.12, 6, 12), (0.04, 5, 8), (0.0, 4, 6))
        for limit, low, high in steps:
            if radius >= limit:
                return high if self.high else low
        raise AssertionError("unreachable")

    def pick(self, low, high):
        """One of two values by level of detail."""
        return high if self.high else low

    def result(self) -> tuple[Patch, np.ndarray, np.ndarray]:
        """All patches as one, with material and segment per triangle."""
        whole = join(*(p for p, _, _ in self._parts))
        material = np.concatenate([np.full(len(p), m, np.uint8) for p, m, _ in self._parts])
        segment = np.concatenate([np.full(len(p), s, np.uint8) for p, _, s in self._parts])
        return whole, material, segment

    # --- parts that many modules carry; ``at`` puts local z along the outward normal, x along the part ---

    def round(self, profile, material: str, at: np.ndarray, **kw) -> None:
        """A surface of revolution about the local z of ``at``."""
        radius = max(r for r, _ in profile)
        self.add(revolve(profile, self.sides(radius), **kw), material, at)

    def handrail(self, at: np.ndarray, length: float, *, fine: bool = False) -> None:
        """A rail along local x, 9 cm off the surface, on posts (left out where they are too small to see)."""
        half, high = 0.5 * length, 0.09
        bar = [(-half, 0, high), (half, 0, high)]
        if self.high or fine:
            self.add(tube([(-half, 0, 0), *bar, (half, 0, 0)], 0.018, 4, False), "handrail", at)
        else:
            self.add(tube(bar, 0.022, 3, False), "handrail", at)

    def grapple(self, at: np.ndarray) -> None:
        """A flight-releasable grapple fixture: round base, three cams, shaft and target."""
        self.add(revolve([(0.30, 0), (0.30, 0.06), (0.24, 0.09), (0, 0.09)], self.sides(0.35)), "anodised", at)
        self.add(tube([(0, 0, 0.09), (0, 0, 0.30), (0, 0, 0.34)], (0.025, 0.025, 0.05), 6), "aluminium", at)
        for k in range(3):
            a = turn(2 * np.pi * k / 3)
            self.add(box((0.16, 0.06, 0.07), (0.2, 0, 0.12)), "dark_metal", at, a)
        self.add(box((0.14, 0.14, 0.02), (0.0, 0.34, 0.08)), "target_black", at)
        self.add(box((0.09, 0.02, 0.03), (0.0, 0.34, 0.10)), "target_white", at)

    def window(self, at: np.ndarray, radius: float = 0.2) -> None:
        """A round porthole with its frame."""
        n = self.sides(max(radius, 0.13))
        self.add(
            revolve([(radius * 1.35, 0.0), (radius * 1.35, 0.05), (radius, 0.05), (radius, 0.02)], n), "anodised", at
        )
        self.add(disc(0.0, radius, 0.02, n), "window", at)

    def ring(self, at: np.ndarray, radius: float, minor: float, material: str, z: float = 0.0) -> None:
        """A round bar about local z; in low detail a hoop."""
        if self.high:
            self.add(torus(radius, minor, self.sides(radius), 4, z), material, at)
        else:
            rows = [(radius + 0.5 * minor, z - minor), (radius + 0.5 * minor, z + minor)]
            self.add(revolve(rows, self.sides(radius)), material, at)

    def dish(self, at: np.ndarray, radius: float, material: str = "white_paint") -> None:
        """A dish antenna that looks along local z, on a short stem."""
        n, d = self.sides(radius), 0.35 * radius
        self.add(revolve([(radius, d), (0.7 * radius, 0.45 * d), (0.0, 0.0)], n, smooth=True), material, at)
        self.add(revolve([(0.0, -0.02), (0.7 * radius, 0.43 * d), (radius, d)], n, smooth=True), material, at)
        self.add(strut((0, 0, -0.02), (0, 0, 1.1 * radius), 0.02, 4), "anodised", at)
        self.add(cylinder(0.06 * radius + 0.02, radius, 1.15 * radius, 6), "dark_metal", at)


def on_barrel(frame: np.ndarray, radius: float, angle: float, height: float) -> np.ndarray:
    """Pose on the outside of a barrel about ``frame``'s z: local z outward, local x along the barrel."""
    c, s = np.cos(angle), np.sin(angle)
    return frame @ pose((radius * c, radius * s, height), (c, s, 0.0), (0.0, 0.0, 1.0))


def around(frame: np.ndarray, radius: float, angle: float, height: float) -> np.ndarray:
    """As :func:`on_barrel`, with local x around the barrel instead of along it."""
    c, s = np.cos(angle), np.sin(angle)
    return frame @ pose((radius * c, radius * s, height), (c, s, 0.0), (-s, c, 0.0))
