"""Where the Sun is, in Hill axes: fixed, drawn, or from the place in the orbit; and whether Earth hides it."""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.errors import InputError, one_of
from lerobot_spacedock.physics.constants import EARTH_EQUATORIAL_RADIUS_m, MEAN_MOTION_rad_s, ORBIT_RADIUS_m

from .config import PORTS

# a quarter of the way up, behind the chaser's left shoulder (the right one at Harmony): the port's rim and target both
# throw shadows
FIXED_SUN_H = {
    "zvezda_aft": np.array([0.52, -0.76, 0.39]) / np.linalg.norm([0.52, -0.76, 0.39]),
    "harmony_forward": np.array([0.52, 0.76, 0.39]) / np.linalg.norm([0.52, 0.76, 0.39]),
}
SUN_ANGULAR_RADIUS_rad = math.radians(0.2666)  # mean, from Earth's distance
_DIP_rad = math.acos(EARTH_EQUATORIAL_RADIUS_m / ORBIT_RADIUS_m)  # the horizon lies this far below level: 20.0 deg
MAX_BETA_rad = math.radians(75.1)  # 51.6 deg inclination + 23.4 deg obliquity


def sun_from_orbit(time_s: float, *, beta_rad: float = 0.35, phase_rad: float = 0.0) -> np.ndarray:
    """Direction to the Sun, (3,) in Hill axes, on a circular orbit.

    Args:
        time_s: s since the phase below.
        beta_rad: rad, the Sun's elevation over the orbit plane, positive towards the orbit normal (+z).
        phase_rad: rad, orbit angle past orbital noon at time 0; noon is when the Sun is highest over the station.
    """
    if not all(map(math.isfinite, (time_s, beta_rad, phase_rad))) or abs(beta_rad) > 0.5 * math.pi:
        raise InputError("sun", (time_s, beta_rad, phase_rad), "finite numbers, |beta_rad| up to π/2")
    angle = phase_rad + MEAN_MOTION_rad_s * time_s
    c = math.cos(beta_rad)
    return np.array([c * math.cos(angle), -c * math.sin(angle), math.sin(beta_rad)])


def draw_sun(generator: np.random.Generator, *, port: str = "zvezda_aft", min_facing: float = 0.15) -> np.ndarray:
    """A random direction to the Sun, (3,) in Hill axes, that lights the port's face and is not behind Earth.

    Args:
        generator: source of randomness.
        port: docking port at the origin.
        min_facing: smallest cosine between the Sun and the port's outward axis.
    """
    one_of("port", port, PORTS)
    outward = -1.0 if port == "zvezda_aft" else 1.0
    while True:
        v = generator.standard_normal(3)
        v /= np.linalg.norm(v)
        if v[1] * outward >= min_facing and v[0] > -math.sin(_DIP_rad):
            return v


def sunlit_share(sun_H: np.ndarray) -> float:
    """Share of the Sun's disc above Earth's limb, 0 (eclipse) to 1."""
    elevation = math.asin(max(-1.0, min(1.0, float(sun_H[0])))) + _DIP_rad
    x = max(-1.0, min(1.0, elevation / SUN_ANGULAR_RADIUS_rad))
    return 0.5 + (x * math.sqrt(1.0 - x * x) + math.asin(x)) / math.pi  # area of a disc cut by a straight edge
