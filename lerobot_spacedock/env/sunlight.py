"""The Sun of an episode."""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.camera.sun import FIXED_SUN_H, MAX_BETA_rad, draw_sun, sun_from_orbit
from lerobot_spacedock.env.random import STREAM_SUN

# A new Sun costs new shadow maps, about ten frames' time; in this long it moves by its own diameter, 0.5 deg.
SUN_REFRESH_s = 8.0
ECLIPSE_SUN_H = np.array([-1.0, 0.0, 0.0])  # straight below: Earth hides it


class SunPath:
    """Direction to the Sun over an episode: ``fixed``, ``random``, ``orbit`` or ``eclipse`` (``--env.sun``)."""

    def __init__(self, mode: str, port: str) -> None:
        self._mode, self._port = mode, port
        self._direction = ECLIPSE_SUN_H if mode == "eclipse" else FIXED_SUN_H[port]
        self._beta_rad = self._phase_rad = 0.0

    def start(self, seed: int) -> None:
        """Draws what is drawn per episode, from the episode's seed alone."""
        generator = np.random.default_rng([seed % 2**63, STREAM_SUN])
        if self._mode == "random":
            self._direction = draw_sun(generator, port=self._port)
        elif self._mode == "orbit":
            self._beta_rad = generator.uniform(-MAX_BETA_rad, MAX_BETA_rad)
            self._phase_rad = generator.uniform(0.0, 2.0 * math.pi)

    def at(self, time_s: float) -> np.ndarray:
        """(3,) unit vector towards the Sun, Hill axes, at a time in the episode; it moves every ``SUN_REFRESH_s``."""
        if self._mode == "orbit":
            time_s = SUN_REFRESH_s * math.floor(time_s / SUN_REFRESH_s)
            return sun_from_orbit(time_s, beta_rad=self._beta_rad, phase_rad=self._phase_rad)
        return self._direction.copy()
