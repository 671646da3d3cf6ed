"""The two docking ports, down to what the camera sees at 0.2 m.

Both are built about local z, which points out of the port along the approach axis, with the docking plane at z = 0;
local x is the station's zenith. Nothing that belongs in the tunnel stands out of the plane, so the camera can fly up to
it.
"""

from __future__ import annotations

import numpy as np

from .builder import Builder, around
from .shapes import box, cylinder, disc, peg, revolve, shift, strut, tube, turn

TARGET_DEPTH_m = 0.40  # the target plate's distance inside the docking plane


def target_cross(b: Builder, at: np.ndarray, plate: float, stand_off: float, *, light_on_dark: bool) -> None:
    """A plate with radial marks and, in front of it, a cross on a post: they line up only on the axis.

    Args:
        at: pose of the plate, local z out.
        plate: m, its radius.
        stand_off: m, distance of the cross in front of the plate.
        light_on_dark: white marks on black, else black on white.
    """
    ink, paper = ("target_white", "target_black") if light_on_dark else ("target_black", "target_white")
    n = b.pick(28, 48)
    b.add(disc(0.0, plate, 0.0, n), paper, at)
    b.add(revolve([(plate, -0.015), (plate, 0.0)], n), "dark_metal", at)
    b.add(disc(0.80 * plate, 0.88 * plate, 0.0012, n), ink, at)
    for k in range(4):
        b.add(box((0.52 * plate, 0.045 * plate, 0.0014), (0.52 * plate, 0, 0.0005)), ink, at, turn(np.pi / 2 * k))
    for k in range(12):
        long = 0.10 if k % 3 else 0.0
        if long:
            b.add(box((long * plate, 0.02 * plate, 0.0014), (0.73 * plate, 0, 0.0005)), ink, at, turn(np.pi / 6 * k))
    arm, thick = 0.36 * plate, 0.055 * plate
    b.add(cylinder(0.035 * plate, 0.0, stand_off - 0.004, 8), "anodised", at)
    cross = ink
    for k in range(2):
        b.add(box((2 * arm, thick, 0.006), (0, 0, stand_off)), cross, at, turn(np.pi / 2 * k))
    for k in range(4):
        b.add(box((0.2 * arm, thick * 1.02, 0.0062), (0.9 * arm, 0, stand_off)), "red", at, turn(np.pi / 2 * k))


def zvezda_port(b: Builder, at: np.ndarray, *, near: bool) -> None:
    """Passive probe-and-drogue port: flange with hooks, drogue cone, its socket with the target; see harmony_port."""
    b.segment = "zvezda_port"
    if not near:
        skirt = [(0.86, -0.46), (0.775, -0.20), (0.745, -0.006)]
        throat = [(0.545, -0.006), (0.41, -0.075), (0.165, -0.345), (0.0, -0.36)]
        b.add(revolve(skirt, b.pick(12, 16)), "russian_white", at)
        b.add(revolve([skirt[-1], throat[0]], b.pick(12, 16)), "machined_ring", at)
        b.add(revolve(throat, b.pick(12, 16)), "drogue", at)
        return
    n = b.pick(40, 72)
    # outer skirt, docking flange with seal grooves, then the throat
    b.add(
        revolve([(0.86, -0.46), (0.80, -0.32), (0.775, -0.20), (0.775, -0.03), (0.745, -0.006)], n), "russian_white", at
    )
    b.add(
        revolve(
            [(0.745, -0.006), (0.70, -0.006), (0.70, 0.0), (0.655, 0.0), (0.655, -0.008), (0.635, -0.008),
             (0.635, -0.001), (0.60, -0.001), (0.60, -0.010), (0.585, -0.010), (0.585, -0.001), (0.545, -0.001)],
            n,
        ),
        "machined_ring", at,
    )  # fmt: skip
    b.add(revolve([(0.545, -0.001), (0.52, -0.03), (0.475, -0.05), (0.43, -0.055), (0.41, -0.075)], n), "anodised", at)
    # dark rubber seals
    for r in (0.5925, 0.645):
        b.add(disc(r - 0.0075, r + 0.0065, -0.0075, n), "black", at)
    # eight hooks and their slots, connectors and guide sockets
    for k in range(8):
        a = turn(np.pi / 8 + np.pi / 4 * k)
        b.add(box((0.038, 0.11, 0.004), (0.6785, 0, 0.001)), "black", at, a)
        b.add(box((0.020, 0.05, 0.012), (0.672, 0.0, 0.003)), "aluminium", at, a)
        b.add(box((0.05, 0.15, 0.05), (0.80, 0, -0.10)), "dark_metal", at, a)
    for k in range(24):
        a = turn(2 * np.pi * (k + 0.5) / 24)
        b.add(peg(0.009, -0.008, 0.006, 6), "dark_metal", at, a, shift(x=0.724))
    for a in (0.25 * np.pi + 0.2, 1.25 * np.pi + 0.2):
        b.add(disc(0.0, 0.026, 0.0012, 12), "black", at, turn(a), shift(x=0.6775))
        b.add(disc(0.026, 0.034, 0.0014, 12), "copper", at, turn(a), shift(x=0.6775))
    for a in (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi):
        b.add(box((0.06, 0.075, 0.012), (0.51, 0, -0.018)), "anodised", at, turn(a + 0.39))
        for i in range(b.pick(2, 6)):
            b.add(
                peg(0.005, -0.012, -0.006, 5),
                "copper",
                at,
                turn(a + 0.39),
                shift(0.496 + 0.0055 * i, 0.025 - 0.01 * i),
            )
    # drogue: a cone that leads the probe's head to the socket, its wear marks, bolts and stiffening step
    b.add(
        revolve([(0.41, -0.075), (0.395, -0.075), (0.385, -0.085), (0.27, -0.225), (0.262, -0.228), (0.165, -0.345)],
        n), "drogue", at,
    )  # fmt: skip
    b.add(
        revolve([(0.165, -0.345), (0.165, -0.365), (0.150, -0.375), (0.150, -TARGET_DEPTH_m - 0.01)], n),
        "machined_ring",
        at,
    )
    for k in range(b.pick(16, 32)):
        a = turn(2 * np.pi * (k + 0.5) / b.pick(16, 32))
        b.add(peg(0.007, -0.08, -0.069, 6), "dark_metal", at, a, shift(x=0.402))
    for k in range(4):  # alignment stripes painted on the cone
        a = turn(np.pi / 2 * k)
        slope = np.arctan2(0.14, 0.115)
        for r, w in ((0.345, 0.060), (0.235, 0.050)):
            z = -0.085 - (0.385 - r) * (0.14 / 0.115) if r > 0.27 else -0.228 - (0.262 - r) * (0.117 / 0.097)
            tilt = np.eye(4)
            tilt[:3, :3] = turn(-slope if r > 0.27 else -np.arctan2(0.117, 0.097), 1)[:3, :3]
            b.add(box((w, 0.012, 0.0016), (0, 0, 0.0006)), "black", at, a, shift(x=r, z=z), tilt)
    # four slots of the latches that hold the probe's head
    for k in range(4):
        b.add(box((0.016, 0.05, 0.028), (0.150, 0, -0.383)), "black", at, turn(np.pi / 4 + np.pi / 2 * k))
    target_cross(b, at @ shift(z=-TARGET_DEPTH_m), 0.150, 0.075, light_on_dark=True)


def harmony_port(b: Builder, at: np.ndarray, *, near: bool) -> None:
    """International Docking Adapter: ring, three petals that lean inwards, hatch with the stand-off cross, targets.

    Args:
        b: the station.
        at: pose of the docking plane.
        near: whether this is the port to dock at; the other is seen from 50 m at best and keeps its large parts only.
    """
    b.segment = "harmony_port"
    body = 0.80
    if not near:
        skirt = [(0.93, -0.62), (0.93, -0.48), (body, -0.36), (0.775, -0.03)]
        passage = [(0.585, 0.0), (0.41, -0.15), (0.41, -0.5), (0.0, -0.5)]
        b.add(revolve(skirt, b.pick(12, 16)), "white_shield", at)
        b.add(revolve([skirt[-1], passage[0]], b.pick(12, 16)), "machined_ring", at)
        b.add(revolve(passage, b.pick(12, 16)), "anodised", at)
        return
    n = b.pick(40, 72)
    # box-like adapter behind the ring: skirt and shield panels
    b.add(
        revolve([(0.93, -0.62), (0.93, -0.48), (0.86, -0.45), (body, -0.36), (body, -0.06), (0.775, -0.03)], n),
        "white_shield",
        at,
    )
    b.add(
        revolve(
            [(0.775, -0.03), (0.765, -0.012), (0.72, -0.012), (0.72, 0.0), (0.676, 0.0), (0.676, -0.008),
             (0.662, -0.008), (0.662, 0.0), (0.63, 0.0), (0.63, -0.008), (0.616, -0.008), (0.616, 0.0),
             (0.585, 0.0), (0.575, -0.02)],
            n,
        ),
        "machined_ring", at,
    )  # fmt: skip
    for r in (0.669, 0.623):
        b.add(disc(r - 0.007, r + 0.007, -0.0065, n), "black", at)
    # soft-capture interface ring with three petals, mechanical latch strikers between them
    b.add(revolve([(0.60, -0.055), (0.615, -0.045), (0.575, -0.02), (0.53, -0.02), (0.53, -0.10)], n), "aluminium", at)
    for k in range(3):
        a = turn(2 * np.pi * k / 3 + np.pi / 6)
        for f0, f1 in ((-1.0, -0.45), (-0.45, 0.0), (0.0, 0.45), (0.45, 1.0)):
            steps = b.pick(2, 4)
            for i in range(steps):
                g0, g1 = f0 + (f1 - f0) * i / steps, f0 + (f1 - f0) * (i + 1) / steps
                for inner in (False, True):
                    (p0, q0), (p1, q1) = _petal(g0, inner), _petal(g1, inner)
                    order = (p0, p1, q1, q0) if not inner else (p1, p0, q0, q1)
                    b.add(_flat(*order), "aluminium", at, a)
                (_, q0), (_, q1) = _petal(g0, False), _petal(g1, False)
                (_, s0), (_, s1) = _petal(g0, True), _petal(g1, True)
                b.add(_flat(q0, q1, s1, s0), "machined_ring", at, a)
        strike = turn(2 * np.pi * k / 3 + np.pi / 6 + np.pi / 3)
        b.add(box((0.05, 0.12, 0.05), (0.545, 0, -0.035)), "anodised", at, strike)
        b.add(box((0.03, 0.06, 0.02), (0.545, 0, -0.006)), "dark_metal", at, strike)
    # twelve hooks, alignment pins and sockets, connectors
    for k in range(12):
        a = turn(2 * np.pi * k / 12)
        b.add(box((0.030, 0.085, 0.004), (0.698, 0, 0.0008)), "black", at, a)
        b.add(box((0.016, 0.040, 0.014), (0.695, 0, 0.004)), "aluminium", at, a)
    for k in range(24):
        b.add(peg(0.008, -0.016, 0.0, 6), "dark_metal", at, turn(2 * np.pi * (k + 0.5) / 24), shift(x=0.742))
    b.add(
        revolve([(0.028, 0.0), (0.026, 0.03), (0.012, 0.06), (0.0, 0.065)], 10),
        "machined_ring",
        at,
        turn(0.26),
        shift(x=0.70),
    )
    b.add(disc(0.0, 0.03, 0.0012, 12), "black", at, turn(0.26 + np.pi), shift(x=0.70))
    # tunnel: passage of 0.8 m, lined, with ducts and rails, down to the hatch
    b.add(revolve([(0.53, -0.10), (0.50, -0.12), (0.455, -0.13), (0.42, -0.16)], n), "anodised", at)
    b.add(
        revolve(
            [
                (0.42, -0.16),
                (0.405, -0.18),
                (0.405, -0.30),
                (0.42, -0.31),
                (0.42, -0.40),
                (0.405, -0.41),
                (0.405, -0.56),
            ],
            n,
        ),
        "tan_cloth",
        at,
    )
    for k in range(b.pick(12, 24)):
        b.add(peg(0.007, -0.14, -0.115, 6), "dark_metal", at, turn(2 * np.pi * k / b.pick(12, 24)), shift(x=0.475))
    for k in range(2):
        b.add(
            tube([(0.385, -0.12, -0.22), (0.385, 0.12, -0.22)], 0.012, 6), "handrail", at, turn(np.pi * k + np.pi / 2)
        )
    # hatch with ribs, window and handle; the target stands on it
    hatch = at @ shift(z=-0.50)
    b.add(disc(0.0, 0.41, 0.0, n), "white_paint", hatch)
    b.add(revolve([(0.405, 0.0), (0.405, 0.022), (0.372, 0.022), (0.368, 0.0)], n), "anodised", hatch)
    b.add(revolve([(0.25, 0.0), (0.25, 0.012), (0.235, 0.012), (0.235, 0.0)], n), "anodised", hatch)
    for k in range(8):
        b.add(box((0.115, 0.018, 0.014), (0.31, 0, 0.006)), "anodised", hatch, turn(np.pi / 8 + np.pi / 4 * k))
    for k in range(16):
        b.add(peg(0.006, 0.0, 0.03, 5), "dark_metal", hatch, turn(2 * np.pi * (k + 0.5) / 16), shift(x=0.388))
    b.add(box((0.03, 0.14, 0.03), (-0.31, 0, 0.02)), "red", hatch, turn(0.6))
    b.add(cylinder(0.04, 0, 0.02, 10), "black", hatch, turn(2.4), shift(x=0.3))
    b.add(cylinder(0.155, 0.0, 0.085, n, caps=False), "anodised", hatch)
    target_cross(b, at @ shift(z=-TARGET_DEPTH_m), 0.16, 0.085, light_on_dark=False)
    # outside: peripheral target on its bracket, hemispherical and planar reflectors, cameras' lights
    bracket = around(at, 0.93, np.pi * 0.25, -0.30)
    b.add(box((0.36, 0.22, 0.03), (0, 0, 0.12)), "anodised", bracket)
    out = at @ turn(np.pi * 0.25) @ shift(x=1.05, z=-0.24)
    b.add(box((0.30, 0.30, 0.03)), "target_black", out)
    for k in range(2):
        b.add(box((0.22, 0.02, 0.008), (0, 0, 0.018)), "target_white", out, turn(np.pi / 2 * k))
        b.add(box((0.11, 0.018, 0.008), (0, 0, 0.13)), "target_white", out, turn(np.pi / 2 * k))
    b.add(peg(0.008, 0.0, 0.13, 6), "anodised", out)
    for k in range(9):
        angle = 2 * np.pi * (k + 0.6) / 9
        spot = at @ turn(angle) @ shift(x=0.90, z=-0.40)
        b.add(box((0.10, 0.13, 0.10), (0, 0, 0)), "dark_metal", spot)
        b.add(disc(0.0, 0.038, 0.0515, 10), "reflector", spot)
        if k % 3 == 0:
            b.add(strut((0, 0, 0), (0.16, 0, 0.10), 0.012, 4), "anodised", spot)
            b.add(cylinder(0.03, 0.06, 0.12, 8), "reflector", spot @ shift(x=0.16))


def _petal(share: float, inner: bool) -> tuple[np.ndarray, np.ndarray]:
    """Foot and rim of a guide petal, an arched plate that leans inwards, at -1..1 across it."""
    height = 0.15 * (1.0 - abs(share) ** 2.2)
    foot = 0.548 - (0.016 if inner else 0.0)
    spoke = np.array([np.cos(0.52 * share), np.sin(0.52 * share), 0.0])
    return foot * spoke + [0, 0, -0.02], (foot - 0.30 * height) * spoke + [0, 0, height - 0.02]


def _flat(p0, p1, p2, p3):
    from .shapes import sheet

    return sheet(p0, p1, p2, p3, both=False)
