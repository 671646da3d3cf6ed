"""The Russian segment: Zvezda, Zarya, Poisk, Nauka, Prichal, Rassvet."""

from __future__ import annotations

import numpy as np

from .builder import Builder, around, on_barrel
from .shapes import box, cylinder, disc, pose, sheet, shift, sphere, strut, tube, turn

ZVEZDA_AFT = (0.23, 32.55, -1.87)
X0, Z0 = 0.23, -1.87
ZENITH, NADIR, FORWARD, AFT = (0, 0, 1), (0, 0, -1), (0, -1, 0), (0, 1, 0)


def solar_panel(b: Builder, at: np.ndarray, length: float, width: float, strips: int, cells: str = "cells_ru") -> None:
    """A hinged wing along local z, its cells towards local x: strips at slightly different tilts, frame and boom."""
    step = length / strips
    for k in range(strips):
        z0, z1 = k * step + 0.03, (k + 1) * step - 0.03
        lean = 0.012 * (1 if k % 2 else -1) + 0.008 * b.rng.standard_normal()
        w = 0.5 * width
        front = sheet(
            (0.02 + lean, -w, z0), (0.02 + lean, w, z0), (0.02 - lean, w, z1), (0.02 - lean, -w, z1), both=False
        )
        b.add(front, cells, at)
        back = sheet((-0.02, w, z0), (-0.02, -w, z0), (-0.02, -w, z1), (-0.02, w, z1), both=False)
        b.add(back, "anodised", at)
        if b.high:
            b.add(strut((-0.03, -w, z0), (-0.03, w, z1), 0.015, 3), "aluminium", at)
    for y in (-0.5 * width, 0.5 * width):
        b.add(strut((0, y, 0), (0, y, length), 0.03, 3), "anodised", at)
    for k in range(0, strips + 1, b.pick(strips, 1)):
        b.add(strut((-0.01, -0.5 * width, k * step), (-0.01, 0.5 * width, k * step), 0.025, 4), "anodised", at)
    b.add(strut((0, 0, -1.2), (-0.06, 0, length), 0.06, 5), "anodised", at)


def rails_around(b: Builder, frame: np.ndarray, radius: float, heights, angles, length: float = 0.9) -> None:
    """Handrails across a barrel."""
    for h in heights:
        for a in angles:
            b.handrail(around(frame, radius, a, h), length)


def rails_along(b: Builder, frame: np.ndarray, radius: float, heights, angles, length: float = 1.2) -> None:
    """Handrails along a barrel."""
    for h in heights:
        for a in angles:
            b.handrail(on_barrel(frame, radius, a, h), length)


def kurs_antenna(b: Builder, at: np.ndarray, length: float) -> None:
    """A rendezvous antenna: dish on a boom along local z."""
    b.add(strut((0, 0, 0), (0, 0, length), 0.025, 5), "anodised", at)
    b.add(strut((0.15, 0, 0), (0, 0, 0.5 * length), 0.015, 4), "anodised", at)
    b.dish(at @ pose((0.02, 0, length), (1, 0, 0.15)), 0.22)


def zvezda(b: Builder) -> None:
    """The service module; its axis frame has z aft, x zenith, and the aft docking plane at z = 0."""
    b.segment = "zvezda"
    f = pose(ZVEZDA_AFT, AFT, ZENITH)
    # assembly compartment: aft bulkhead dished around the transfer chamber, then the large and small work compartments
    b.round([(0.80, -0.62), (1.35, -0.62), (1.95, -0.78)][::-1], "russian_mli", f)
    b.round([(2.09, -2.30), (2.09, -0.90), (2.02, -0.80), (1.95, -0.78)], "russian_mli", f)
    b.round([(2.06, -6.35), (2.06, -2.30)], "russian_white", f)
    b.round([(1.45, -7.55), (2.06, -6.35)], "russian_white", f)
    b.round([(1.45, -10.9), (1.45, -7.55)], "russian_mli", f)
    b.round([(1.05, -11.35), (1.45, -10.9)], "russian_mli", f)
    b.add(sphere(1.13, b.pick(14, 56)), "russian_white", f, shift(z=-12.35))
    b.round([(0.75, -14.30), (0.75, -13.2)], "anodised", f)
    for z, r in ((-2.30, 2.10), (-4.2, 2.075), (-6.35, 2.08), (-7.55, 1.47), (-9.2, 1.46), (-10.9, 1.47)):
        b.ring(f, r, 0.035, "anodised", z)
    # aft face: two main engines under rims, attitude thrusters in clusters, wiring covers, hold-down brackets
    for side in (-1.0, 1.0):
        e = f @ shift(y=1.38 * side, z=-0.62)
        b.round([(0.36, 0.0), (0.36, 0.10), (0.31, 0.10), (0.31, 0.02)], "anodised", e)
        b.round(
            [(0.10, -0.05), (0.20, 0.02), (0.28, 0.16), (0.27, 0.16), (0.19, 0.0), (0.08, -0.10)][:3], "dark_metal", e
        )
        b.round([(0.275, 0.16), (0.19, 0.02), (0.09, -0.08), (0.0, -0.09)], "copper", e)
        b.add(box((0.10, 0.55, 0.05), (0.36, 0, 0.05)), "russian_white", e)
        b.add(box((0.10, 0.55, 0.05), (-0.36, 0, 0.05)), "russian_white", e)
    for k in range(4):
        t = f @ turn(np.pi / 4 + np.pi / 2 * k)
        block = t @ shift(x=1.72, z=-0.62)
        b.add(box((0.42, 0.70, 0.30), (0, 0, 0.02), 0.05), "russian_mli", block)
        for i in range(4):
            nozzle = block @ shift(0.09 * (i % 2) - 0.03, -0.24 + 0.16 * i, 0.16)
            b.add(_nozzle(0.055, 0.09, b), "dark_metal", nozzle)
        for s in (-1, 1):
            b.add(_nozzle(0.05, 0.10, b), "dark_metal", block @ pose((0.12, 0.37 * s, 0.02), (0.35, s, 0)))
    for k in range(12):
        a = 2 * np.pi * (k + 0.35) / 12
        t = f @ turn(a)
        b.add(
            box((0.34, 0.12 + 0.1 * (k % 3), 0.09), (1.12, 0, -0.59), 0.02),
            ("russian_white", "anodised", "tan_cloth")[k % 3],
            t,
        )
        if k % 2:
            b.add(tube([(0.84, 0.05, -0.56), (1.2, 0.12, -0.555), (1.62, 0.06, -0.64)], 0.016, 4, False), "black", t)
    # retro-reflectors for approaching ships, on the bulkhead and around the flange
    for k in range(b.pick(14, 26)):
        a = 2 * np.pi * k / b.pick(14, 26) + 0.1
        t = f @ turn(a) @ shift(x=0.95 + 0.06 * (k % 2), z=-0.56)
        b.add(cylinder(0.035, -0.06, 0.0, 6, caps=False), "anodised", t)
        b.add(disc(0.0, 0.034, 0.0, 6), "reflector", t)
    # the visual target of Soyuz and Progress, off to one side
    from .ports import target_cross

    side_target = f @ turn(np.pi * 0.5 + 0.42) @ shift(x=1.02, z=-0.34)
    b.add(strut((0, 0, -0.3), (0, 0, 0), 0.03, 5), "anodised", side_target)
    target_cross(b, side_target, 0.14, 0.20, light_on_dark=False)
    for k in range(8):
        b.handrail(f @ turn(np.pi / 8 + np.pi / 4 * k) @ pose((1.40, 0, -0.58), (0, 0, 1), (0, 1, 0)), 0.75, fine=True)
    rails_around(b, f, 2.09, (-1.2, -2.1), np.arange(8) * np.pi / 4 + 0.2)
    rails_around(b, f, 2.06, (-3.2, -4.6, -6.0), np.arange(7) * 2 * np.pi / 7)
    rails_along(b, f, 2.06, (-3.9, -5.4), (0.4, 1.3, 2.2, 3.4, 4.3, 5.3), 1.3)
    rails_along(b, f, 1.45, (-8.3, -9.9), (0.2, 1.2, 2.0, 3.1, 4.2, 5.1), 1.1)
    # windows along the nadir side, boxes, antennas
    for h in (-3.0, -3.8, -5.2, -8.2, -9.6):
        b.window(on_barrel(f, 2.06 if h > -7 else 1.45, np.pi + 0.2, h))
    for k, (a, h, sx, sy, sz) in enumerate(
        ((0.0, -2.9, 1.0, 0.6, 0.35), (1.1, -4.0, 0.9, 0.5, 0.25), (2.4, -3.3, 1.3, 0.5, 0.3),
         (5.4, -4.9, 0.8, 0.7, 0.3),
         (4.2, -3.0, 0.7, 0.7, 0.4), (0.6, -8.6, 0.9, 0.5, 0.3), (3.8, -9.1, 1.2, 0.4, 0.25),
         (2.9, -5.6, 0.6, 0.6, 0.45))
    ):  # fmt: skip
        at = on_barrel(f, 2.05 if h > -7 else 1.44, a, h)
        b.add(
            box((sx, sy, sz), (0, 0, 0.5 * sz), 0.03), ("russian_mli", "tan_cloth", "anodised", "silver_mli")[k % 4], at
        )
    kurs_antenna(b, around(f, 2.0, 0.55, -1.0) @ turn(-0.9, 0), 1.5)
    kurs_antenna(b, around(f, 2.0, 0.55 + np.pi, -1.0) @ turn(0.9, 0), 1.5)
    lira = on_barrel(f, 2.06, 0.06, -5.9)
    b.add(strut((0, 0, 0), (0.1, 0, 1.5), 0.04, 5), "anodised", lira)
    b.dish(lira @ pose((0.1, 0, 1.5), (0.5, 0, 1)), 0.48)
    for a in (0.9, 2.2, 4.0, 5.3):  # whip antennas at the rim
        b.add(tube([(0, 0, 0), (0.1, 0, 0.5), (0.5, 0, 0.9)], 0.012, 4, False), "anodised", on_barrel(f, 2.09, a, -1.0))
    # arrays: two wings at the fore end of the large compartment, 29.7 m tip to tip
    for side in (1.0, -1.0):
        root = f @ pose((0, 2.05 * side, -5.75), (0, side, 0), (-0.35, 0, 1.0))
        b.round([(0.24, 0.0), (0.24, 0.55), (0.15, 0.6)], "anodised", root)
        solar_panel(b, root @ shift(z=1.6), 11.2, 3.3, 10)


def _nozzle(radius: float, length: float, b: Builder):
    from .shapes import join, revolve

    n = b.pick(5, 10)
    return join(
        revolve([(0.4 * radius, 0), (0.75 * radius, 0.5 * length), (radius, length)], n),
        revolve([(0.97 * radius, length), (0.4 * radius, 0.1 * length), (0, 0.05 * length)], n),
    )


def zarya(b: Builder) -> None:
    """The functional cargo block, fore of Zvezda; z aft, from y = 5.0 to 18.3."""
    b.segment = "zarya"
    f = pose((X0, 18.28, Z0), AFT, ZENITH)
    b.round([(0.75, -13.3), (0.75, -12.9), (1.02, -12.6), (1.45, -12.0), (2.02, -10.2), (2.05, -9.9)], "russian_mli", f)
    b.round([(2.05, -9.9), (2.05, -4.6)], "russian_white", f)
    b.round([(2.05, -4.6), (2.05, -2.0), (1.45, -1.05), (0.78, -0.5), (0.78, 0.0)], "russian_mli", f)
    for z in (-9.9, -7.2, -4.6, -2.0):
        b.ring(f, 2.07, 0.035, "anodised", z)
    rails_around(b, f, 2.05, (-2.6, -5.6, -8.2), np.arange(6) * np.pi / 3 + 0.3)
    rails_along(b, f, 2.05, (-3.6, -6.6, -9.0), (0.5, 1.8, 2.8, 4.0, 5.6), 1.3)
    for a in (0.35, 1.25, 2.6, 3.7, 5.1):  # propellant tanks along the flanks
        tank = on_barrel(f, 2.12, a, -6.5)
        b.add(
            tube(
                [(-2.4, 0, 0.1), (-2.2, 0, 0.16), (2.2, 0, 0.16), (2.4, 0, 0.1)], (0.08, 0.2, 0.2, 0.08), b.sides(0.2)
            ),
            "russian_mli",
            tank,
        )
    for side in (1.0, -1.0):  # its arrays were folded to clear the radiators
        root = f @ pose((0, 2.0 * side, -8.6), (0, side, 0), (0.2, 0, 1.0))
        b.round([(0.22, 0.0), (0.22, 0.5)], "anodised", root)
        b.add(box((0.5, 3.3, 0.55), (0, 0, 0.9)), "cells_ru", root)
    for a in (0.8, 3.6):
        kurs_antenna(b, around(f, 2.0, a, -11.2), 0.9)
    b.grapple(on_barrel(f, 2.05, 5.0, -3.2))
    b.window(on_barrel(f, 2.05, 2.3, -4.0))


def poisk(b: Builder) -> None:
    """Docking compartment on Zvezda's zenith; z zenith."""
    b.segment = "poisk"
    f = pose((X0, 20.13, 3.56), ZENITH, AFT)
    b.round(
        [(0.68, -4.5), (0.68, -4.1), (1.27, -3.5), (1.27, -1.2), (0.85, -0.35), (0.68, -0.25), (0.68, 0.0)],
        "russian_white",
        f,
    )
    b.ring(f, 1.29, 0.03, "anodised", -1.2)
    b.ring(f, 1.29, 0.03, "anodised", -3.4)
    for a in (np.pi / 2, -np.pi / 2):  # the two hatches for space walks
        h = on_barrel(f, 1.27, a, -2.4)
        b.round([(0.56, -0.05), (0.56, 0.10), (0.48, 0.12), (0.0, 0.12)], "anodised", h)
        b.ring(h, 0.62, 0.02, "handrail", 0.16)
    rails_around(b, f, 1.27, (-1.5, -3.2), np.arange(5) * 2 * np.pi / 5)
    b.add(box((0.6, 0.5, 0.3), (0, 0, 0.15)), "tan_cloth", on_barrel(f, 1.25, 0.1, -2.6))


def rassvet(b: Builder) -> None:
    """Mini-research module on Zarya's nadir; z nadir."""
    b.segment = "rassvet"
    f = pose((0.24, 7.16, -9.27), NADIR, AFT)
    b.round([(0.70, -5.5), (0.70, -5.1), (1.17, -4.6), (1.17, -0.9), (0.75, -0.3), (0.70, 0.0)], "russian_mli", f)
    for z in (-4.6, -2.7, -0.9):
        b.ring(f, 1.19, 0.03, "anodised", z)
    rails_along(b, f, 1.17, (-1.7, -3.6), np.arange(5) * 2 * np.pi / 5 + 0.2, 1.1)
    b.add(box((1.2, 1.3, 0.06), (0, 0, 0.2)), "radiator", on_barrel(f, 1.15, np.pi / 2, -2.6))
    b.grapple(on_barrel(f, 1.17, 2.6, -2.0))


def nauka(b: Builder) -> None:
    """Multipurpose laboratory on Zvezda's nadir; z nadir, 13.1 m, with the European arm, radiator and airlock."""
    b.segment = "nauka"
    f = pose((X0, 20.13, -3.05), NADIR, AFT)
    b.round([(0.75, 0.0), (0.75, 0.45), (1.02, 0.7), (1.45, 1.1), (1.45, 2.3), (2.1, 3.3)], "russian_mli", f)
    b.round([(2.12, 3.3), (2.12, 8.9)], "russian_white", f)
    b.round([(2.12, 8.9), (2.12, 10.4), (1.45, 11.5), (1.02, 12.2), (0.78, 12.5), (0.78, 13.1)], "russian_mli", f)
    for z in (3.3, 6.0, 8.9):
        b.ring(f, 2.14, 0.035, "anodised", z)
    rails_around(b, f, 2.12, (4.2, 7.2, 9.6), np.arange(7) * 2 * np.pi / 7)
    rails_along(b, f, 2.12, (5.0, 8.0), (0.5, 1.6, 2.6, 4.1, 5.2), 1.3)
    for side in (1.0, -1.0):
        root = f @ pose((0, 2.1 * side, 4.3), (0, side, 0), (1.0, 0, 0.3))
        b.round([(0.22, 0.0), (0.22, 0.6)], "anodised", root)
        solar_panel(b, root @ shift(z=1.4), 8.3, 2.9, 8)
    for a in (0.9, 2.3, 3.9, 5.4):
        tank = on_barrel(f, 2.16, a, 6.2)
        b.add(
            tube(
                [(-2.2, 0, 0.1), (-2.0, 0, 0.18), (2.0, 0, 0.18), (2.2, 0, 0.1)],
                (0.08, 0.22, 0.22, 0.08),
                b.sides(0.22),
            ),
            "russian_mli",
            tank,
        )
    # outfitted radiator, folded, and the airlock
    b.add(box((4.2, 1.9, 0.10), (0, 0, 0.35)), "radiator", on_barrel(f, 2.12, 0.35, 6.4))
    lock = on_barrel(f, 2.0, np.pi + 0.5, 9.6)
    b.round([(0.55, 0), (0.55, 0.8), (0.3, 1.0), (0, 1.0)], "silver_mli", lock)
    # European Robotic Arm, stowed along the barrel
    arm = on_barrel(f, 2.35, 4.75, 6.0)
    path = [(-3.6, 0.0, 0.1), (-3.2, 0, 0.35), (0.0, 0.45, 0.55), (3.2, 0.0, 0.35), (3.6, 0, 0.1)]
    b.add(tube(path, 0.125, b.sides(0.13)), "white_paint", arm)
    for p in path[1:-1]:
        b.add(cylinder(0.21, -0.25, 0.25, b.sides(0.2)), "beta_cloth", arm, shift(*p))
    kurs_antenna(b, around(f, 2.0, 1.4, 11.0), 1.0)
    for h in (5.6, 7.4):
        b.window(on_barrel(f, 2.12, 0.0, h), 0.22)


def prichal(b: Builder) -> None:
    """The node below Nauka: a ball with ports."""
    b.segment = "prichal"
    f = pose((X0, 20.13, -17.9), NADIR, AFT)
    b.add(sphere(1.62, b.pick(16, 56)), "russian_mli", f)
    b.round([(0.75, -1.9), (0.75, -1.3)], "anodised", f)
    for axis in ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)):
        p = f @ pose(np.array(axis) * 1.45, axis)
        rows = [(0.78, 0.0), (0.75, 0.28), (0.62, 0.30), (0.45, 0.20), (0.0, 0.12)]
        b.round(b.pick([rows[0], rows[1], rows[4]], rows), "anodised", p)
    for k in range(6):
        b.handrail(f @ turn(k * np.pi / 3) @ pose((1.2, 0, 1.15), (1, 0, 1), (0, 1, 0)), 0.7)
