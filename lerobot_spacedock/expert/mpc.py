"""Minimum-energy model-predictive control on the HCW model, in closed form, for a batch.

Each step plans the accelerations that reach the goal with least ``Σ|a|²`` and flies the first of them:

- ``fixed``: the goal at a deadline, with the steps that are left (a shrinking horizon; re-planned every step);
- ``receding``: the time to go is itself free, chosen by ``energy + weight · time``: a law of the state alone, without a
  clock, that an imitator can copy.

The unconstrained quadratic programme has a linear solution: ``a = Mᵀ (M Mᵀ + ρ)⁻¹ (goal − Φ x)`` with ``M`` the
transition's response to each step's acceleration. There are no constraints, of thrust or corridor; commands are clipped
to the limits afterwards, which some plans reach (in ``SpaceDock-v0`` at the port, from wider starts at the beginning).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.classical import ClassicalPolicy
from lerobot_spacedock.expert.deadline import Deadline
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port
from lerobot_spacedock.physics.relative_motion import hcw_transition_matrix

# Terminal errors of position and velocity are weighed against energy, (m per m/s²)² and (m/s per m/s²)², not forbidden:
# with one or two steps left six conditions cannot be met, and an exact solution would spend the limits on a
# millimetre. Where the port is flown through at a speed, being there half a second late costs nothing.
SOFTNESS_AT_REST = (0.01, 0.01)
SOFTNESS_AT_SPEED = (3.0, 0.1)
# Free time, at the reference step; of shorter steps as many more, each of which weighs less.
SOFTNESS_FREE_TIME = 0.6
FEWEST_STEPS_FREE_TIME = 4
FREE_TIME_WEIGHT_m2_s4 = 1.6e-3  # arrives from the reference start after about 65 steps
LONGEST_PLAN_STEPS = 120


def held_response(step_s: float) -> np.ndarray:
    """(6, 3) change of (r, v) over a step under unit accelerations held in Hill axes (Simpson; error ~ (n·step)⁴)."""
    middle = hcw_transition_matrix(0.5 * step_s, MEAN_MOTION_rad_s)[:, 3:]
    end = hcw_transition_matrix(step_s, MEAN_MOTION_rad_s)[:, 3:]
    start = np.eye(6)[:, 3:]
    return step_s / 6.0 * (start + 4.0 * middle + end)


@cache
def plans(longest: int, step_s: float, softness: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Plans of 1 to ``longest`` steps: (longest, 6, 6) transitions, (longest, 3, 6) gains, (longest, 6, 6) costs.

    With ``e = goal − transition @ x`` the first acceleration is ``gain @ e`` and the energy ``e @ cost @ e``.
    """
    step = hcw_transition_matrix(step_s, MEAN_MOTION_rad_s)
    response = held_response(step_s)
    transition, gramian = np.eye(6), np.diag(np.repeat(softness, 3))
    transitions, gains, costs = [], [], []
    for _ in range(longest):
        first = transition @ response  # of the plan's first step, seen at its end
        gramian = gramian + first @ first.T
        transition = transition @ step
        cost = np.linalg.inv(gramian)
        transitions.append(transition)
        gains.append(first.T @ cost)
        costs.append(cost)
    return np.array(transitions), np.array(gains), np.array(costs)


class MpcPolicy(ClassicalPolicy):
    """Minimum-energy MPC.

    Args:
        deadline: steps (``fixed`` only), their expected length, and the closing speed to arrive with.
        mode: ``fixed`` or ``receding``.
        time_weight_m2_s4: ``receding`` only: what a step is worth in ``Σ|a|²``; larger arrives sooner.
        port: where to dock.
        hill_coupling: as in ``ClassicalPolicy``.
    """

    def __init__(
        self,
        deadline: Deadline | None = None,
        *,
        mode: str = "fixed",
        time_weight_m2_s4: float = FREE_TIME_WEIGHT_m2_s4,
        port: Port = ZVEZDA_AFT,
        hill_coupling: bool = False,
    ) -> None:
        super().__init__(port=port, hill_coupling=hill_coupling)
        if mode not in ("fixed", "receding"):
            raise InputError("mode", mode, "fixed | receding")
        self._deadline = deadline or Deadline()
        self._time_weight = time_weight_m2_s4
        if mode == "fixed":
            softness = SOFTNESS_AT_SPEED if self._deadline.closing_speed_m_s > 0.0 else SOFTNESS_AT_REST
            self._law, longest = self._at_deadline, self._deadline.steps
        else:
            shorter = max(1.0, Deadline.step_s / self._deadline.step_s)
            softness = (SOFTNESS_FREE_TIME / shorter,) * 2
            self._law, longest = self._free_time, math.ceil(LONGEST_PLAN_STEPS * shorter)
            self._fewest = FEWEST_STEPS_FREE_TIME * shorter
        self._transitions, self._gains, self._costs = plans(longest, self._deadline.step_s, softness)

    def acceleration(self, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Commanded acceleration, m/s². (N, 3), (N, 3) → (N, 3)."""
        return self._law(np.concatenate([r, v], axis=1))

    def _at_deadline(self, state: np.ndarray) -> np.ndarray:
        left = self._deadline.steps - self.step
        planned = max(left, 1)
        goal = self._deadline.goal((planned - left) * self._deadline.step_s)
        error = goal - state @ self._transitions[planned - 1].T
        return error @ self._gains[planned - 1].T

    def _free_time(self, state: np.ndarray) -> np.ndarray:
        rows, step_s = np.arange(len(state)), self._deadline.step_s
        errors = self._deadline.goal(0.0) - np.einsum("kij,nj->nki", self._transitions, state)
        steps = 1.0 + np.arange(len(self._transitions))
        value = np.einsum("nki,kij,nkj->nk", errors, self._costs, errors) + self._time_weight * steps
        best = 1 + np.argmin(value[:, 1:-1], axis=1)
        before, here, after = value[rows, best - 1], value[rows, best], value[rows, best + 1]
        # vertex of the parabola through three plans: else the whole number of steps would show in the command
        bend = np.maximum(before - 2.0 * here + after, 1e-12)
        arrival = steps[best] + np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
        planned = np.maximum(arrival, self._fewest)
        whole = np.floor(planned).astype(np.int64)
        command = 0.0
        for count, weight in ((whole, whole + 1.0 - planned), (whole + 1, planned - whole)):
            # a plan longer or shorter than the arrival ends farther along the line through the port
            goal = self._deadline.goal(0.0) + np.zeros((len(state), 1))
            goal[:, :3] += ((count - arrival) * step_s)[:, None] * goal[:, 3:]
            error = goal - np.einsum("nij,nj->ni", self._transitions[count - 1], state)
            command = command + weight[:, None] * np.einsum("nij,nj->ni", self._gains[count - 1], error)
        return command
