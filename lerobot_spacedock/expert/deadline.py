"""When and how fast to arrive: what a controller with a clock is told, and a policy without one is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.errors import in_range

MID_BAND_CLOSING_SPEED_m_s = 0.075  # IDSS: 0.05 to 0.10 m/s
RANGES = {"steps": (1, 1_000_000), "step_s": (0.001, 99.0), "closing_speed_m_s": (0.0, 1.0)}  # of Deadline's attributes


@dataclass(frozen=True)
class Deadline:
    """Arrival at the port after a number of steps.

    Attributes:
        steps: until arrival; 65 is the paper's horizon.
        step_s: expected length of a step (the reference rollouts' mean); the controllers see no clock of the env's.
        closing_speed_m_s: at arrival; 0 to stop at the port.
    """

    steps: int = 65
    step_s: float = 0.907
    closing_speed_m_s: float = MID_BAND_CLOSING_SPEED_m_s

    def __post_init__(self) -> None:
        for name, (low, high) in RANGES.items():
            in_range(f"deadline.{name}", getattr(self, name), low, high)

    def time_left_s(self, step: int) -> float:
        """Expected time from the start of step ``step`` to the deadline; negative after it."""
        return (self.steps - step) * self.step_s

    def goal(self, after_s: float) -> np.ndarray:
        """(6,) where to be, and how fast, ``after_s`` past arrival: on through the port at the same speed."""
        velocity = np.array([0.0, self.closing_speed_m_s, 0.0])
        return np.concatenate([after_s * velocity, velocity])
