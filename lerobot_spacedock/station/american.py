"""The American, European and Japanese modules: Unity to Harmony, Columbus, Kibo, Tranquility and what hangs on them."""

from __future__ import annotations

import numpy as np

from .builder import Builder, around, on_barrel
from .russian import AFT, FORWARD, NADIR, ZENITH
from .shapes import box, cylinder, pose, revolve, shift, strut, tube, turn

X0, Z0 = 0.21, -2.60
PORT, STARBOARD = (1, 0, 0), (-1, 0, 0)


def barrel(b: Builder, frame: np.ndarray, length: float, radius: float, *, skin: str = "white_shield",
           cone: float = 0.65, mouth: float = 1.0, ends: tuple[bool, bool] = (True, True)) -> None:  # fmt: skip
    """A pressurised module along local z: barrel, end cones, berthing rings, girth rings, bumper gaps."""
    rims = b.pick(([], []), ([(radius - 0.10, cone - 0.05)], [(radius - 0.10, length - cone + 0.05)]))
    b.round([(mouth, 0.16), *rims[0], (radius, cone)], skin, frame)
    b.round([(radius, cone), (radius, length - cone)], skin, frame)
    b.round([(radius, length - cone), *rims[1], (mouth, length - 0.16)], skin, frame)
    for z0, z1, closed in ((0.0, 0.16, ends[0]), (length - 0.16, length, ends[1])):
        b.round([(mouth + 0.05, z0), (mouth + 0.05, z1)], "aluminium", frame)
        if closed:
            low = z0 == 0.0
            rows = [(mouth + 0.05, 0.0), (0.0, 0.0)]
            b.round([(r, length) for r, _ in rows] if not low else rows[::-1], "anodised", frame)
    for z in np.linspace(cone, length - cone, max(3, int(length / 2.0))):
        b.ring(frame, radius + 0.005, 0.028, "anodised", z)


def hatch_ring(b: Builder, at: np.ndarray, covered: bool = True) -> None:
    """A common berthing mechanism that nothing is berthed to: ring, petals' covers, dished cover."""
    b.round([(1.02, -0.25), (1.02, 0.10), (0.92, 0.12), (0.86, 0.05)], "aluminium", at)
    if covered:
        b.round([(0.88, 0.06), (0.6, 0.10), (0.0, 0.12)], "beta_cloth", at)
        for k in range(4):
            b.add(box((0.30, 0.62, 0.05), (0.78, 0, 0.12)), "anodised", at, turn(np.pi / 4 + k * np.pi / 2))


def outfit(b: Builder, frame: np.ndarray, radius: float, h0: float, h1: float, seed: int, rails: int = 6) -> None:
    """Rails, small boxes, cables and a grapple fixture over a barrel between two heights."""
    rng = np.random.Generator(np.random.PCG64(seed))
    rows = max(2, int((h1 - h0) / 1.9))
    for k in range(rails):
        a = 2 * np.pi * (k + 0.25 * rng.random()) / rails
        for i in range(rows):
            h = h0 + (h1 - h0) * (i + 0.5) / rows
            if (i + k) % 2:
                b.handrail(on_barrel(frame, radius, a, h), 1.15)
            else:
                b.handrail(around(frame, radius, a + 0.2, h), 0.85)
    for _ in range(b.pick(4, 10)):
        a, h = 2 * np.pi * rng.random(), h0 + 0.5 + (h1 - h0 - 1.0) * rng.random()
        size = 0.25 + 0.5 * rng.random(3)
        kind = ("beta_cloth", "anodised", "white_paint", "silver_mli")[int(rng.integers(4))]
        b.add(box((size[0], size[1], 0.12 + 0.2 * size[2]), (0, 0, 0.08), 0.02), kind, on_barrel(frame, radius, a, h))
    for _ in range(b.pick(2, 6)):
        a, h = 2 * np.pi * rng.random(), h0 + (h1 - h0) * (0.2 + 0.5 * rng.random())
        at = on_barrel(frame, radius, a, h)
        b.add(
            tube([(-0.9, 0, 0.03), (-0.2, 0.08, 0.05), (0.5, -0.1, 0.05), (1.0, 0, 0.03)], 0.022, 4, False), "black", at
        )


def nodes_and_labs(b: Builder) -> None:
    """Unity, Destiny and Harmony in line."""
    b.segment = "unity"
    f = pose((X0, 3.0, Z0), FORWARD, ZENITH)
    barrel(b, f, 5.5, 2.28)
    outfit(b, f, 2.28, 0.8, 4.7, 11)
    b.segment = "pma"
    b.round([(0.95, 0), (0.72, 1.1), (0.72, 2.05)], "dark_mli", pose((X0, 3.0, Z0), AFT, ZENITH))
    b.segment = "destiny"
    f = pose((X0, -2.5, Z0), FORWARD, ZENITH)
    barrel(b, f, 8.5, 2.15)
    outfit(b, f, 2.15, 0.8, 7.7, 12, 7)
    b.window(on_barrel(f, 2.15, np.pi, 4.2), 0.3)
    b.grapple(on_barrel(f, 2.15, 2.2, 2.0))
    b.segment = "harmony"
    f = pose((X0, -11.0, Z0), FORWARD, ZENITH)
    barrel(b, f, 7.1, 2.2)
    outfit(b, f, 2.2, 0.8, 6.4, 13, 7)
    for a in (0.55, 2.6, 3.7):
        b.grapple(on_barrel(f, 2.2, a, 1.6))
    for a, lift in ((0.0, 2.34), (np.pi, 2.34)):  # zenith and nadir berthing ports
        hatch_ring(b, on_barrel(f, lift, a, 3.94), covered=a != 0.0)
    for a in (np.pi / 2, -np.pi / 2):
        b.round([(1.12, -0.4), (1.12, 0.30)], "aluminium", on_barrel(f, 2.2, a, 3.94))
    # forward end: corner stand-offs and cable trays round the adapter
    for k in range(8):
        a = np.pi / 8 + k * np.pi / 4
        b.handrail(f @ turn(a) @ pose((1.5, 0, 6.83), (0.35, 0, 1), (0, 1, 0)), 0.7)
    for k in range(6):
        a = 2 * np.pi * (k + 0.3) / 6
        b.add(box((0.45, 0.3, 0.2), (1.62, 0, 6.72), 0.03), ("beta_cloth", "anodised")[k % 2], f, turn(a))


def forward_adapter(b: Builder) -> None:
    """PMA-2, a cone whose axis is displaced, between Harmony and the docking adapter."""
    b.segment = "pma"
    start = np.array([X0, -18.1, Z0])
    end = np.array([0.19, -20.84 + 0.60, -3.34])
    n = b.sides(0.8)
    rings = ((0.0, 0.97), (0.22, 0.97), (0.30, 0.92), (0.62, 0.80), (0.80, 0.70), (1.0, 0.70))
    profile = revolve([(r, s * (start[1] - end[1])) for s, r in rings], n)
    shear = pose(start, FORWARD, ZENITH)
    lean = np.eye(4)
    d = np.linalg.inv(shear[:3, :3]) @ (end - start)
    lean[0, 2], lean[1, 2] = d[0] / d[2], d[1] / d[2]
    b.add(profile, "dark_mli", shear, lean)
    for s, r in ((0.11, 1.0), (0.62, 0.83), (0.93, 0.74)):
        b.ring(shear @ lean, r, 0.04, "anodised", s * d[2])
    for k in range(8):
        a = k * np.pi / 4 + 0.2
        b.handrail(shear @ lean @ turn(a) @ pose((0.88, 0, 0.42 * d[2]), (1, 0, 0.15), (0, 0, 1)), 0.7)
    for k in range(5):
        a = 2 * np.pi * k / 5 + 0.6
        b.add(
            box((0.3, 0.35, 0.18), (0.98, 0, 0.30 * d[2]), 0.03),
            ("anodised", "beta_cloth")[k % 2],
            shear,
            lean,
            turn(a),
        )
    for a in (0.9, 2.5, 4.4):
        b.add(
            tube([(0.98, 0, 0.1), (0.90, 0.1, 0.6), (0.78, 0.0, 1.3), (0.74, 0.05, d[2])], 0.025, 4, False),
            "black",
            shear,
            lean,
            turn(a),
        )
    b.round(
        [(0.74, d[2] - 0.10), (0.95, d[2] - 0.04), (0.95, d[2] + 0.02), (0.0, d[2] + 0.02)], "anodised", shear @ lean
    )


def columbus(b: Builder) -> None:
    """On Harmony's starboard side; z starboard."""
    b.segment = "columbus"
    f = pose((X0 - 2.5, -14.94, Z0), STARBOARD, ZENITH)
    barrel(b, f, 6.9, 2.24, skin="white_shield")
    outfit(b, f, 2.24, 0.8, 6.1, 14)
    b.grapple(on_barrel(f, 2.24, 0.5, 5.2))
    b.add(cylinder(1.9, 6.62, 6.9, b.sides(1.9)), "white_shield", f)
    for y, z, kind in (
        (0.8, 1.0, "silver_mli"),
        (0.8, -1.0, "gold_mli"),
        (-0.9, 0.9, "beta_cloth"),
        (-0.9, -1.0, "white_paint"),
    ):
        at = f @ shift(y, z, 6.9)  # the external payload platforms
        b.add(box((1.1, 1.1, 0.12), (0, 0, 0.1)), "anodised", at)
        b.add(box((0.8, 0.7, 0.7), (0, 0, 0.5), 0.05), kind, at)
        b.add(cylinder(0.2, 0.85, 1.1, b.sides(0.2)), "white_paint", at)


def kibo(b: Builder) -> None:
    """On Harmony's port side; z port; with the logistics module above, the exposed facility and the arm."""
    b.segment = "kibo"
    f = pose((X0 + 2.5, -14.94, Z0), PORT, ZENITH)
    barrel(b, f, 11.2, 2.2)
    outfit(b, f, 2.2, 0.8, 10.4, 15, 7)
    for y in (-0.55, 0.55):
        b.window(f @ pose((0.75, y, 11.21), (0, 0, 1)), 0.28)
    lock = f @ pose((-0.45, 0.0, 11.2), (0, 0, 1))
    b.round([(0.78, 0), (0.78, 0.45), (0.66, 0.5), (0, 0.5)], "aluminium", lock)
    logistics = pose((X0 + 2.5 + 8.6, -14.94, Z0 + 2.2), ZENITH, AFT)
    barrel(b, logistics, 4.2, 2.2)
    outfit(b, logistics, 2.2, 0.6, 3.6, 16)
    b.grapple(logistics @ shift(0.6, 0.5, 4.2))
    # exposed facility: a slab with payload boxes on its rim
    slab = f @ shift(x=-1.0, z=11.9)
    b.add(box((3.4, 4.6, 5.2), (-0.6, 0, 2.6)), "beta_cloth", slab)
    b.add(box((3.5, 4.7, 0.2), (-0.6, 0, 0.4)), "anodised", slab)
    kinds = ("gold_mli", "white_paint", "silver_mli", "beta_cloth", "dark_mli", "white_shield")
    for k in range(8):
        side = 1 if k % 2 else -1
        at = slab @ shift(-0.6 + 0.9 * (k % 3 - 1), side * 3.1, 0.9 + 1.15 * (k // 2))
        b.add(box((1.0, 1.5, 0.85), bevel=0.04), kinds[k % 6], at)
        b.add(box((0.5, 0.3, 0.5), (0, -side * 0.8, 0)), "anodised", at)
    arm = f @ shift(x=2.0, z=11.3)
    b.add(
        tube(
            [(0, -0.4, 0), (0.6, -0.4, 0.2), (1.6, -0.9, 3.4), (1.0, -1.6, 6.4), (0.2, -1.6, 6.6)], 0.13, b.sides(0.13)
        ),
        "white_paint",
        arm,
    )
    for p in ((0.6, -0.4, 0.2), (1.6, -0.9, 3.4), (1.0, -1.6, 6.4)):
        b.add(cylinder(0.24, -0.28, 0.28, b.sides(0.2)), "beta_cloth", arm, shift(*p))


def tranquility(b: Builder) -> None:
    """On Unity's port side; with the Cupola below, Leonardo ahead and BEAM behind; Quest on the other side."""
    b.segment = "tranquility"
    f = pose((X0 + 2.5, 0.2, Z0), PORT, ZENITH)
    barrel(b, f, 6.7, 2.24)
    outfit(b, f, 2.24, 0.8, 5.9, 17)
    b.grapple(on_barrel(f, 2.24, 0.8, 5.0))
    b.segment = "cupola"
    c = pose((X0 + 2.5 + 4.6, 0.2, Z0 - 2.2), NADIR, AFT)
    b.round([(1.45, -0.1), (1.45, 0.35)], "white_shield", c)
    n = 6
    b.add(revolve([(1.45, 0.35), (0.72, 1.25)], n), "anodised", c)
    b.round([(0.72, 1.25), (0.62, 1.27), (0.55, 1.27)], "anodised", c)
    b.window(c @ shift(z=1.27), 0.42)
    for k in range(6):
        a = (k + 0.5) * np.pi / 3
        at = c @ turn(a) @ pose((0.96, 0, 0.80), (0.9, 0, 0.6), (0, 1, 0))
        b.add(box((0.66, 0.62, 0.02), (0, 0, 0.02)), "window", at)
        shutter = c @ turn(a) @ pose((1.62, 0, 1.05), (0.25, 0, 1), (0, 1, 0))
        b.add(box((0.85, 0.95, 0.05)), "beta_cloth", shutter)
    b.segment = "leonardo"
    p = pose((X0 + 2.5 + 4.6, -2.1, Z0), FORWARD, ZENITH)
    barrel(b, p, 6.4, 2.2)
    outfit(b, p, 2.2, 0.7, 5.8, 18)
    b.segment = "beam"
    e = pose((X0 + 2.5 + 4.6, 2.5, Z0), AFT, ZENITH)
    b.round(
        [(1.0, 0), (1.2, 0.3), (1.58, 0.75), (1.62, 1.6), (1.58, 2.6), (1.2, 3.3), (0.9, 3.6), (0.0, 3.65)],
        "beta_cloth",
        e,
        smooth=True,
    )
    b.segment = "quest"
    q = pose((X0 - 2.5, 0.2, Z0), STARBOARD, ZENITH)
    barrel(b, q, 3.2, 2.0, cone=0.5)
    outfit(b, q, 2.0, 0.5, 2.8, 19)
    b.round([(1.0, 3.2), (1.05, 3.4), (1.05, 5.3), (0.9, 5.5), (0.0, 5.5)], "white_shield", q)
    for k in range(4):  # high-pressure gas tanks
        a = np.pi / 4 + k * np.pi / 2
        tank = q @ turn(a) @ shift(x=2.35, z=1.6)
        b.add(
            tube([(0, 0, -0.75), (0, 0, -0.6), (0, 0, 0.6), (0, 0, 0.75)], (0.2, 0.45, 0.45, 0.2), b.sides(0.45)),
            "beta_cloth",
            tank,
        )
        b.add(strut((-0.4, 0, 0), (0, 0, 0), 0.05, 4), "anodised", tank)
    rails = on_barrel(q, 1.05, 0.3, 4.3)
    b.handrail(rails, 1.2)
    b.ring(q, 0.62, 0.025, "handrail", 5.54)
