"""The integrated truss with its equipment, eight array wings, radiators and the big arm."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .builder import Builder
from .shapes import box, cylinder, pose, sheet, shift, sphere, strut, tube, turn

Y0, Z0 = -5.0, 3.0  # axis of the truss, station axes
HALF_SPAN = 51.0
GAMMA_WING = np.radians(16.0)  # the wings' lean from the vertical plane, both sides alike
SECTION = np.array([(1.1, 2.05), (2.15, 0.3), (1.55, -1.95), (-1.55, -1.95), (-2.15, 0.3), (-1.1, 2.05)])  # (y, z)


def truss(b: Builder) -> None:
    """Lattice from tip to tip, equipment inside and out, rails, joints."""
    b.segment = "truss"
    kinds = ("beta_cloth", "white_paint", "anodised", "silver_mli", "gold_mli", "tan_cloth")
    for sign in (-1.0, 1.0):
        edges = np.concatenate([np.linspace(0.0, 22.0, 10), np.linspace(25.0, HALF_SPAN, 11)])
        for k in range(len(edges) - 1):
            x0, x1 = sign * edges[k], sign * edges[k + 1]
            slim = 0.72 if edges[k] >= 24.0 else 1.0
            if edges[k] == 22.0:
                continue
            ring0 = np.array([(x0, Y0 + slim * y, Z0 + slim * z) for y, z in SECTION])
            ring1 = np.array([(x1, Y0 + slim * y, Z0 + slim * z) for y, z in SECTION])
            n = b.pick(3, 4)
            # longerons run straight on: in low detail three bays in one piece
            first = k - (k if k < 9 else k - 10) % 3
            last = min(first + 3, 9 if k < 9 else len(edges) - 1)
            for i in range(6):
                j = (i + 1) % 6
                if b.high:
                    b.add(strut(ring0[i], ring1[i], 0.075, n), "aluminium")
                elif k == first:
                    far = ring1[i] + [sign * (edges[last] - edges[k + 1]), 0.0, 0.0]
                    b.add(strut(ring0[i], far, 0.075, n), "aluminium")
                if not b.high and (i + k) % 3 == 0:
                    continue
                b.add(strut(ring0[i], ring0[j], 0.06, n), "aluminium")
                if (i + k) % 2:
                    b.add(strut(ring0[i], ring1[j], 0.045, 3), "anodised")
                elif b.high:
                    b.add(strut(ring0[j], ring1[i], 0.045, 3), "anodised")
            # boxes inside and on the faces
            mid = 0.5 * (x0 + x1)
            wide = 0.72 * abs(x1 - x0)
            b.add(box((wide, 1.5 * slim, 1.7 * slim), (mid, Y0, Z0 - 0.2), 0.1), kinds[(k + (sign > 0)) % 2 * 2])
            for _ in range(b.pick(2, 6)):
                face = int(b.rng.integers(6))
                c = 0.5 * (SECTION[face] + SECTION[(face + 1) % 6]) * slim * 1.04
                at = (mid + (b.rng.random() - 0.5) * wide * 0.7, Y0 + c[0], Z0 + c[1])
                s = 0.5 + 0.6 * b.rng.random(3)
                b.add(box((s[0], s[1] * 0.8, s[2] * 0.8), at, 0.03), kinds[int(b.rng.integers(6))])
        _joint(b, sign)
    # mobile base system and its rails on the forward face
    for z in (-1.4, 0.9):
        b.add(box((44.0, 0.14, 0.18), (0, Y0 - 2.05, Z0 + z)), "aluminium")
    b.add(box((3.2, 1.0, 2.6), (3.4, Y0 - 2.9, Z0 - 0.2), 0.1), "beta_cloth")
    for x in (2.2, 4.6):
        b.grapple(pose((x, Y0 - 3.4, Z0 + 0.5), (0, -1, 0)))
    # antennas on top, S0 struts down to Destiny
    for x in (-3.2, 3.6, -1.2):
        b.add(strut((x, Y0, Z0 + 2.0), (x, Y0, Z0 + 3.6), 0.07, 5), "anodised")
    b.dish(pose((3.6, Y0, Z0 + 3.7), (0.2, 0.5, 1)), 0.95)
    b.add(box((0.6, 0.6, 0.5), (-3.2, Y0, Z0 + 3.8)), "gold_mli")
    for x, y in ((-1.6, -2.6), (1.9, -2.6), (-1.6, -7.4), (1.9, -7.4)):
        b.add(strut((x, Y0 + 0.3 * (y - Y0), Z0 - 1.9), (0.21 + 0.6 * np.sign(x), y, -1.0), 0.11, 6), "white_paint")
    # external stowage platforms and logistics carriers
    for x, z in ((-17.5, 2.6), (-17.5, -3.0), (19.0, 2.7), (19.0, -3.0)):
        at = (x, Y0 + 0.4, Z0 + z)
        b.add(box((4.3, 3.4, 0.25), at), "anodised")
        for _ in range(5):
            o = (b.rng.random(2) - 0.5) * (3.4, 2.6)
            s = 0.6 + 0.6 * b.rng.random(3)
            lift = np.sign(z) * (0.12 + 0.5 * s[2])
            b.add(box(s, (at[0] + o[0], at[1] + o[1], at[2] + lift), 0.03), kinds[int(b.rng.integers(6))])


def _joint(b: Builder, sign: float) -> None:
    """Solar alpha rotary joint: two big rings and the drum between."""
    f = pose((sign * 22.0, Y0, Z0), (sign, 0, 0), (0, 0, 1))
    rows = [(1.25, 0.0), (1.62, 0.05), (1.62, 0.35), (1.2, 0.45), (1.2, 1.8), (1.55, 1.9), (1.55, 2.2), (1.1, 2.3),
            (0.8, 3.0)]  # fmt: skip
    b.round(b.pick([rows[k] for k in (0, 1, 2, 3, 5, 6, 8)], rows), "aluminium", f)
    b.ring(f, 1.64, 0.06, "gold_mli", 0.2)
    for k in range(6):
        b.add(box((0.3, 0.4, 1.0), (1.3, 0, 1.1)), "beta_cloth", f, turn(k * np.pi / 3))


def wings(b: Builder) -> None:
    """Eight wings: at x = ±34 and ±50, one up and one down at each, two blankets and a mast each."""
    b.segment = "arrays"
    for k, x in enumerate((-50.0, -34.0, 34.0, 50.0)):
        for up in (1.0, -1.0):
            direction = np.array([0.0, np.sin(GAMMA_WING) * up, np.cos(GAMMA_WING) * up])
            facing = np.array([0.0, np.cos(GAMMA_WING), -np.sin(GAMMA_WING)])
            at = pose(np.array([x, Y0, Z0]) + 2.1 * direction, direction, facing)
            _wing(b, at, k % 2 == int(up > 0))


def _wing(b: Builder, at: np.ndarray, roll_out: bool) -> None:
    """One wing along local z with its cells towards local x; 35 m long, 11.6 m wide."""
    length, inner, outer = 33.6, 0.75, 5.8
    b.add(strut((0, 0, -1.9), (0, 0, 0.5), 0.35, 8), "aluminium", at)
    b.add(box((0.8, 1.3, 1.3), (0, 0, 0.1), 0.08), "beta_cloth", at)
    strips = b.pick(10, 36)
    for side in (-1.0, 1.0):
        b.add(box((0.22, 4.9, 0.45), (0, side * 3.3, 0.75)), "anodised", at)
        b.add(box((0.16, 4.9, 0.30), (0, side * 3.3, 1.0 + length)), "anodised", at)
        y0, y1 = side * inner, side * outer
        low, high = min(y0, y1), max(y0, y1)
        for s in range(strips):
            z0, z1 = 1.0 + length * s / strips, 1.0 + length * (s + 1) / strips - 0.02
            d = 0.018 * (1 if s % 2 else -1) * (34.0 / strips) * 0.5 + 0.006 * b.rng.standard_normal()
            b.add(
                sheet((0.01 + d, low, z0), (0.01 + d, high, z0), (0.01 - d, high, z1), (0.01 - d, low, z1), both=False),
                "cells_us",
                at,
            )
            b.add(
                sheet(
                    (-0.01 + d, high, z0), (-0.01 + d, low, z0), (-0.01 - d, low, z1), (-0.01 - d, high, z1), both=False
                ),
                "kapton_back",
                at,
            )
    # mast: a square lattice of longerons, battens and diagonals
    r, bays, n = 0.38, b.pick(6, 26), 3
    posts = np.array([(r, r), (-r, r), (-r, -r), (r, -r)])
    for i in range(4):
        j = (i + 1) % 4
        b.add(strut((*posts[i], 0.7), (*posts[i], 1.0 + length), 0.03, n), "aluminium", at)
        for k in range(bays):
            z0, z1 = 0.8 + length * k / bays, 0.8 + length * (k + 1) / bays
            b.add(strut((*posts[i], z0), (*posts[j], z1), 0.02, n), "aluminium", at)
    if roll_out:  # newer roll-out array in front of the inboard half, canted ten degrees
        tilt = at @ shift(x=0.7, z=1.2) @ turn(-np.radians(10.0), 1)
        for side in (-1.0, 1.0):
            low, high = sorted((side * 0.35, side * 3.1))
            for s in range(b.pick(4, 12)):
                m = b.pick(4, 12)
                z0, z1 = 18.6 * s / m, 18.6 * (s + 1) / m - 0.02
                b.add(sheet((0, low, z0), (0, high, z0), (0, high, z1), (0, low, z1), both=False), "cells_us", tilt)
                b.add(
                    sheet((-0.01, high, z0), (-0.01, low, z0), (-0.01, low, z1), (-0.01, high, z1), both=False),
                    "kapton_back",
                    tilt,
                )
            b.add(strut((0, side * 3.15, 0), (0, side * 3.15, 18.8), 0.08, 5), "dark_metal", tilt)
        b.add(strut((0, -3.2, 0), (0, 3.2, 0), 0.16, 6), "anodised", tilt)
        b.add(strut((0, -3.2, 18.7), (0, 3.2, 18.7), 0.1, 5), "anodised", tilt)
        b.add(strut((-0.7, 0, -1.0), (0, 0, 0), 0.1, 5), "aluminium", tilt)


def radiators(b: Builder) -> None:
    """Two fans of three big radiators that trail aft, four small ones at the array pairs."""
    b.segment = "radiators"
    for x in (-15.0, 15.0):
        hub = np.array([x, Y0 + 2.0, Z0 - 0.6])
        lean = np.radians(-14.0)
        direction = np.array([0.0, np.cos(lean), np.sin(lean)])
        at = pose(hub, direction, (0, -np.sin(lean), np.cos(lean)))
        b.add(box((1.0, 7.5, 0.9), (0, 0, 0.3), 0.05), "anodised", at)
        for k in (-1, 0, 1):
            _panel(b, at @ shift(y=3.75 * k, z=1.2), 21.0, 3.3, 8)
    for x in (-29.5, 29.5, -43.0, 43.0):
        at = pose((x, Y0 + 1.2, Z0 - 0.2), (0, 0.97, 0.25), (0, -0.25, 0.97))
        _panel(b, at @ shift(z=0.8), 11.5, 3.2, 7)
        b.add(box((0.5, 2.0, 0.8), (0, 0, 0.3)), "anodised", at)


def _panel(b: Builder, at: np.ndarray, length: float, width: float, leaves: int) -> None:
    """A folding radiator along local z: leaves at alternate tilts, hinge bars, scissor links behind."""
    step, w = length / leaves, 0.5 * width
    for k in range(leaves):
        d = 0.09 * (1 if k % 2 else -1)
        z0, z1 = k * step + 0.04, (k + 1) * step - 0.04
        b.add(
            sheet((d + 0.02, -w, z0), (d + 0.02, w, z0), (0.02 - d, w, z1), (0.02 - d, -w, z1), both=False),
            "radiator",
            at,
        )
        b.add(
            sheet((d - 0.02, w, z0), (d - 0.02, -w, z0), (-0.02 - d, -w, z1), (-0.02 - d, w, z1), both=False),
            "radiator",
            at,
        )
        b.add(strut((0.02, -w, z1 + 0.04), (0.02, w, z1 + 0.04), 0.035, 3), "anodised", at)
    for y in (-0.3 * width, 0.3 * width) if b.high else ():
        b.add(
            tube([(-0.25 if k % 2 else 0.0, y, k * step) for k in range(leaves + 1)], 0.035, 3, False), "anodised", at
        )


def canadarm(b: Builder) -> None:
    """Canadarm2, from its base on the mobile platform up and across; with Dextre beside it."""
    b.segment = "canadarm2"
    n = b.sides(0.17)
    path = [
        (3.4, -8.6, 3.6),
        (3.4, -9.6, 4.4),
        (3.0, -10.3, 5.1),
        (-3.2, -10.8, 8.3),
        (-8.2, -11.4, 4.6),
        (-8.6, -11.2, 3.6),
        (-8.6, -10.6, 3.0),
    ]
    for p, q in pairwise(path):
        b.add(strut(p, q, 0.175, n), "white_paint")
    for p in path[1:-1]:
        b.add(sphere(0.27, b.sides(0.25)), "beta_cloth", shift(*p))
        b.add(cylinder(0.22, -0.42, 0.42, n), "beta_cloth", pose(p, (0.2, 1, 0.3)))
    for p in (path[0], path[-1]):
        b.add(cylinder(0.32, -0.5, 0.5, n), "anodised", pose(p, (0, 1, 0.5)))
    for s in (0.35, 0.8):
        p = np.array(path[2]) * (1 - s) + np.array(path[3]) * s
        b.add(cylinder(0.19, -0.05, 0.05, n), "dark_metal", pose(p, np.array(path[3]) - path[2]))
    dextre = pose((-8.6, -10.0, 2.3), (0, 0.3, -1))
    b.add(box((1.0, 1.2, 2.4), (0, 0, 0.9), 0.08), "beta_cloth", dextre)
    for side in (-1.0, 1.0):
        b.add(
            tube(
                [(0, side * 0.6, 0.2), (0.2, side * 1.5, 0.4), (0.6, side * 1.7, 1.8), (0.9, side * 1.0, 2.9)], 0.12, n
            ),
            "white_paint",
            dextre,
        )
