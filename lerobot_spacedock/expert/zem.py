"""ZEM/ZEV guidance: the classical optimal law for reaching a place at a speed at a time.

    a = 6/t_go² · ZEM − 2/t_go · ZEV

ZEM and ZEV are the miss and the speed error that free motion would leave at the deadline, here with HCW's exact
transition in place of the usual integrated gravity.

Source: Ebrahimi, Bahrami and Roshanian, "Optimal sliding-mode guidance with terminal velocity constraint for
fixed-interval propulsive maneuvers", Acta Astronautica 62 (2008); Guo, Hawkins and Wie, J. Guid. Control Dyn. 36
(2013).
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.expert.classical import ClassicalPolicy
from lerobot_spacedock.expert.deadline import Deadline
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port
from lerobot_spacedock.physics.relative_motion import hcw_transition_matrix

SHORTEST_TIME_TO_GO_s = 2.0  # gains grow as 6/t_go²; below this the law would chase its own sampling


class ZemZevPolicy(ClassicalPolicy):
    """ZEM/ZEV guidance to the port, arriving at a deadline with a closing speed.

    After the deadline (contact flown with a late start, say) the goal moves on through the port at that speed.

    Args:
        deadline: steps, their expected length, and the closing speed to arrive with.
        port: where to dock.
        hill_coupling: as in ``ClassicalPolicy``.
    """

    def __init__(
        self, deadline: Deadline | None = None, *, port: Port = ZVEZDA_AFT, hill_coupling: bool = False
    ) -> None:
        super().__init__(port=port, hill_coupling=hill_coupling)
        self._deadline = deadline or Deadline()

    def acceleration(self, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Commanded acceleration, m/s². (N, 3), (N, 3) → (N, 3)."""
        left_s = self._deadline.time_left_s(self.step)
        to_go_s = max(left_s, SHORTEST_TIME_TO_GO_s)
        transition = hcw_transition_matrix(to_go_s, MEAN_MOTION_rad_s)
        free = np.concatenate([r, v], axis=1) @ transition.T
        goal = self._deadline.goal(to_go_s - left_s)
        miss, speed_error = goal[:3] - free[:, :3], goal[3:] - free[:, 3:]
        now = 6.0 / to_go_s**2 * miss - 2.0 / to_go_s * speed_error
        end = -6.0 / to_go_s**2 * miss + 4.0 / to_go_s * speed_error
        # the optimal acceleration is linear in time; a command held over a step has to be its mean there
        return now + (end - now) * (0.5 * self._deadline.step_s / to_go_s)
