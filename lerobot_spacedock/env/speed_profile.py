"""How fast to close, over distance: flat at the port, so that arriving a little early or late changes nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_TABLE_TIME_s = 400.0
_TABLE_STEP_s = 0.02


@dataclass(frozen=True)
class SpeedProfile:
    """Closing speed over distance: ``v(t_go) = v_contact + c t_go^power``, softly limited at ``cruise``.

    Attributes:
        contact_m_s: speed at the port and beyond its plane.
        cruise_m_s: speed far away.
        braking_s: time to go at which the unlimited profile reaches the cruise speed.
        power: of time to go; above 1 the profile is flat near the port.
        softness: exponent of the soft minimum; larger is a sharper corner.
    """

    contact_m_s: float = 0.078
    cruise_m_s: float = 0.78
    braking_s: float = 32.0
    power: float = 1.5
    softness: float = 5.0

    def table(self) -> tuple[np.ndarray, np.ndarray]:
        """Distances (m, increasing from 0) and the closing speeds there (m/s), dense enough to interpolate."""
        c = (self.cruise_m_s - self.contact_m_s) / self.braking_s**self.power
        time = np.arange(0.0, _TABLE_TIME_s, _TABLE_STEP_s)
        distance = self.contact_m_s * time + c * time ** (self.power + 1.0) / (self.power + 1.0)
        speed = self.contact_m_s + c * time**self.power
        limited = (speed**-self.softness + self.cruise_m_s**-self.softness) ** (-1.0 / self.softness)
        # the soft minimum lowers the contact speed by a relative 1e-6: keep what was asked for
        return distance, limited * self.contact_m_s / limited[0]

    def sampled(self, spacing_m: float, count: int) -> np.ndarray:
        """(count,) speeds at 0, ``spacing_m``, 2 ``spacing_m``, …"""
        return np.interp(spacing_m * np.arange(count), *self.table())
