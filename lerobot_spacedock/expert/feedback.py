"""A time-invariant state-feedback law: the teacher that an imitator can copy, and the reference for the learnt one.

Along the docking axis it follows a profile of closing speed over distance, flat near the port and arriving in the
middle of the allowed band, with a gain that grows towards the port; across it a critically damped PD; HCW and the
profile's own deceleration are fed forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.env.speed_profile import SpeedProfile
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.classical import ClassicalPolicy, hill_acceleration
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port


@dataclass(frozen=True)
class FeedbackGains:
    """Gains of the feedback law.

    Attributes:
        far_1_s: of the closing speed's error, far from the port.
        near_1_s: the same at the port.
        gain_range_m: distance over which the one goes into the other.
        lateral_rad_s: frequency of the critically damped lateral PD.
    """

    far_1_s: float = 0.065
    near_1_s: float = 0.3
    gain_range_m: float = 3.0
    lateral_rad_s: float = 0.11


# W: smoothest. V: fastest, for the fixed horizon of 65 steps. Q: between. (docs/experts.md has their numbers)
LAWS = {
    "W": (SpeedProfile(), FeedbackGains()),
    "V": (SpeedProfile(cruise_m_s=0.86, braking_s=28.0, power=1.6), FeedbackGains(far_1_s=0.07)),
    "Q": (
        SpeedProfile(cruise_m_s=0.8, braking_s=30.0, power=1.6),
        FeedbackGains(far_1_s=0.08, lateral_rad_s=0.12),
    ),
}


class FeedbackPolicy(ClassicalPolicy):
    """The time-invariant teacher law.

    Args:
        law: one of ``LAWS``, or a pair of profile and gains.
        port: where to dock.
        hill_coupling: as in ``ClassicalPolicy``.
    """

    def __init__(
        self,
        law: str | tuple[SpeedProfile, FeedbackGains] = "W",
        *,
        port: Port = ZVEZDA_AFT,
        hill_coupling: bool = False,
    ) -> None:
        super().__init__(port=port, hill_coupling=hill_coupling)
        if isinstance(law, str) and law not in LAWS:
            raise InputError("law", law, " | ".join(LAWS))
        profile, self._gains = LAWS[law] if isinstance(law, str) else law
        self._distance, self._speed = profile.table()
        self._slope = np.gradient(self._speed, self._distance)

    def acceleration(self, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Commanded acceleration, m/s². (N, 3), (N, 3) → (N, 3)."""
        gains = self._gains
        distance = -r[:, 1]
        speed = np.interp(distance, self._distance, self._speed)
        slope = np.where(distance > 0.0, np.interp(distance, self._distance, self._slope), 0.0)
        near = np.exp(-np.maximum(distance, 0.0) / gains.gain_range_m)
        gain = gains.far_1_s + (gains.near_1_s - gains.far_1_s) * near
        wanted = -(gains.lateral_rad_s**2) * r - 2.0 * gains.lateral_rad_s * v
        # the speed falls as the distance does: dv/dt = v'(d) · (-closing speed)
        wanted[:, 1] = -slope * v[:, 1] + gain * (speed - v[:, 1])
        return wanted - hill_acceleration(r, v)
