"""Certainty equivalence in front of a classical law: what one scalar of adaptation is worth.

A chaser may be heavier than the nominal one, and its thrusters weaker: what a law sees of both is one number, how much
of the acceleration that it commanded its velocity shows. That number is estimated as the flight goes, and the law's
thrust divided by it.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.expert.classical import hill_acceleration
from lerobot_spacedock.expert.policy import ACTION_LIMITS, Policy, check_observation
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.constants import CHASER_MASS_kg

# what is known beforehand: mass and thrusters within about a fifth of the nominal ones, velocities to a few mm/s
PRIOR_SPREAD = 0.15
VELOCITY_NOISE_m_s = 0.003
BOUNDS = (0.5, 2.0)


class AdaptiveThrust:
    """A law whose thrust is divided by an estimate of how much of it acts.

    The estimate ``k`` is of least squares over the episode so far, ``Δv − Δv_HCW = k · C(q) T / m · Δt``, all three
    axes together, drawn towards 1 by a Gaussian prior. Recursive, so a step costs what the first did.

    Args:
        law: any policy; it never sees the estimate.
        step_s: the mean length of a step (the policy is not told the true one).
    """

    def __init__(self, law: Policy, *, step_s: float = TaskConfig.time_step_mean_s) -> None:
        self._law = law
        self._step_s = step_s

    def reset(self, count: int) -> None:
        """Forgets the estimates of earlier episodes."""
        self._law.reset(count)
        prior = 2.0 * VELOCITY_NOISE_m_s**2 / PRIOR_SPREAD**2  # a velocity's change has the noise of two readings
        self._information, self._evidence = np.full(count, prior), np.full(count, prior)
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    @property
    def scale(self) -> np.ndarray:
        """(N,) the estimates: acceleration shown over acceleration commanded."""
        return np.clip(self._evidence / self._information, *BOUNDS)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """(N, 13) ``observation.state`` → (N, 6) N and N·m, body axes, within the limits."""
        seen = check_observation(observation, len(self._information))
        r, v, q = seen[:, 0:3], seen[:, 3:6], rotations.normalize(seen[:, 6:10])
        if self._last is not None:
            before_v, free, commanded = self._last
            shown = v - before_v - free
            self._information += np.sum(commanded * commanded, axis=1)
            self._evidence += np.sum(commanded * shown, axis=1)
        command = self._law.act(observation).astype(np.float64)
        command[:, :3] /= self.scale[:, None]
        command = np.clip(command, -ACTION_LIMITS, ACTION_LIMITS)
        change = rotations.rotate(q, command[:, :3]) * (self._step_s / CHASER_MASS_kg)
        self._last = v, hill_acceleration(r, v) * self._step_s, change
        return command
