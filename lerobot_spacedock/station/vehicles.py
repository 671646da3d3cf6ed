"""Ships at the other ports: Soyuz at Poisk and Rassvet, Progress at Prichal, Dragon at Harmony's zenith."""

from __future__ import annotations

import numpy as np

from .builder import Builder, around, on_barrel
from .russian import AFT, NADIR, ZENITH, _nozzle, solar_panel
from .shapes import box, cylinder, pose, revolve, shift, sphere, strut, turn


def soyuz(b: Builder, at: np.ndarray, *, cargo: bool = False) -> None:
    """Docked at local z = 0, its tail towards +z: orbital module, descent module, service module, wings."""
    b.segment = "progress" if cargo else "soyuz"
    n = b.sides(1.1)
    skin = "soyuz_green" if not cargo else "russian_mli"
    b.round([(0.66, 0.0), (0.66, 0.35), (0.80, 0.45)], "anodised", at)
    if cargo:
        b.round([(0.80, 0.45), (1.09, 0.95), (1.09, 2.5), (0.95, 2.8), (1.09, 3.2), (1.09, 4.4)], skin, at)
    else:
        b.add(sphere(1.12, n, -1.12, 1.18), skin, at, shift(z=1.5))
        b.round([(0.62, 2.52), (0.62, 2.68)], "anodised", at)
        b.round([(0.62, 2.66), (0.86, 2.85), (1.07, 3.7), (1.09, 4.35)], skin, at, smooth=True)
    b.round([(1.09, 4.35), (1.09, 6.0), (1.36, 6.9), (1.36, 7.15), (1.0, 7.25), (0.0, 7.22)], skin, at)
    for z in (4.4, 6.0):
        b.ring(at, 1.10, 0.03, "anodised", z)
    b.round([(0.14, 7.2), (0.32, 7.45), (0.30, 7.45), (0.10, 7.22)], "dark_metal", at)
    for k in range(4):
        b.add(
            _nozzle(0.06, 0.12, b), "dark_metal", at, turn(np.pi / 4 + k * np.pi / 2), pose((1.36, 0, 7.0), (1, 0, 0.6))
        )
    b.add(box((1.9, 0.9, 0.05), (0, 0, 0.06)), "radiator", on_barrel(at, 1.1, np.pi / 4, 5.2))
    for side in (1.0, -1.0):
        root = at @ pose((0, 1.1 * side, 5.6), (0, side, 0), (0.3, 0, 1))
        solar_panel(b, root @ shift(z=0.75), 3.6, 1.2, 4)
    for a in (0.0, np.pi):
        boom = around(at, 0.95, a, 1.9 if not cargo else 2.9)
        b.add(strut((0, 0, 0), (0, 0.0, 0.9), 0.02, 4), "anodised", boom)
        b.dish(boom @ pose((0, 0, 0.9), (0, 1, 0.2)), 0.18)
    if not cargo:
        b.window(on_barrel(at, 1.05, np.pi / 2, 3.6), 0.13)
        b.round([(0.36, 0), (0.36, 0.04), (0, 0.05)], "anodised", on_barrel(at, 1.1, -np.pi / 2, 1.5))


def dragon(b: Builder, at: np.ndarray) -> None:
    """Crew Dragon docked at local z = 0, its trunk towards +z."""
    b.segment = "dragon"
    b.round([(0.66, 0.0), (0.70, 0.12), (0.98, 0.35)], "machined_ring", at)
    b.round([(0.98, 0.35), (1.10, 0.60), (1.86, 3.35), (1.92, 3.75)], "white_paint", at)
    b.round([(1.92, 3.75), (1.96, 3.86), (1.85, 3.98)], "tile_dark", at)
    b.round([(1.85, 3.98), (1.85, 7.6), (1.75, 7.6)], "white_paint", at)
    b.round([(1.75, 7.6), (1.75, 4.3), (0.0, 4.3)], "dark_metal", at)
    for k in range(12):  # solar cells on one half of the trunk
        a = np.pi * (k + 0.5) / 12
        b.add(box((3.3, 0.42, 0.02), (0, 0, 0.012)), "cells_ru", on_barrel(at, 1.85, a, 5.8))
    for k in range(4):
        fin = at @ turn(np.pi / 4 + k * np.pi / 2)
        b.add(box((0.75, 0.06, 1.5), (2.2, 0, 6.7)), "white_paint", fin)
        pod = fin @ pose((1.62, 0, 2.5), (0.94, 0, -0.26), (0.26, 0, 0.94))
        b.add(box((1.7, 0.95, 0.34), (0, 0, 0.05), 0.2), "white_paint", pod)
        for s in (-0.22, 0.22):
            b.add(_nozzle(0.11, 0.14, b), "dark_metal", pod @ pose((0.45, s, 0.2), (0.5, 0, 1)))
    for a in (0.55, -0.55):
        b.add(
            box((0.36, 0.36, 0.02), (0, 0, 0.03), 0.02),
            "window",
            at @ turn(np.pi + a) @ pose((1.4, 0, 1.7), (0.96, 0, -0.27)),
        )
    b.add(
        cylinder(0.52, 0.0, 0.03, b.sides(0.5)), "white_shield", at, turn(np.pi), pose((1.52, 0, 2.1), (0.96, 0, -0.27))
    )
    nose = at @ pose((1.25, 0, 0.55), (0.75, 0, -0.7), (0, 1, 0))  # nose cap, swung open
    b.add(
        revolve([(0.86, 0.0), (0.80, 0.3), (0.5, 0.6), (0.0, 0.72)], b.sides(0.8), smooth=True),
        "white_paint",
        nose,
        shift(z=0.2),
    )
    b.add(revolve([(0.0, 0.05), (0.86, 0.0)][::-1], b.sides(0.8)), "dark_metal", nose, turn(np.pi, 0), shift(z=-0.2))


def fleet(b: Builder) -> None:
    """All of them. The two ports that the chaser may use stay free."""
    soyuz(b, pose((0.23, 20.13, 3.56), ZENITH, AFT) @ turn(0.5))
    soyuz(b, pose((0.24, 7.16, -9.27), NADIR, AFT) @ turn(0.8))
    soyuz(b, pose((0.23, 20.13, -19.6), NADIR, AFT), cargo=True)
    zenith = pose((0.23, -14.94, -0.22), ZENITH, AFT)
    b.segment = "pma"
    b.round([(0.97, 0.0), (0.92, 0.3), (0.74, 1.0), (0.72, 1.5)], "dark_mli", zenith)
    b.round([(0.80, 1.5), (0.80, 2.2), (0.62, 2.25)], "white_shield", zenith)
    dragon(b, zenith @ shift(z=2.2) @ turn(np.pi))
