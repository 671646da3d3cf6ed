"""Many episodes of a trained ACT at once, and what the metrics make of them.

LeRobot's own ``ACTTemporalEnsembler`` takes a batch, so one network call serves all episodes of a step. A test compares
every episode with ``lerobot-eval``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from lerobot.policies.act.modeling_act import ACTTemporalEnsembler
from lerobot.utils.constants import OBS_ENV_STATE, OBS_STATE

from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig
from lerobot_spacedock.dataset.flight import fly
from lerobot_spacedock.dataset.schema import observed_names
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.metrics.episode import episode_metrics
from lerobot_spacedock.physics.frames import OBSERVATION_NAMES
from lerobot_spacedock.study.students import Student


class Pilot:
    """A student as the simulator's policy: ``reset``, ``act``.

    Args:
        student: the trained policy.
        coefficient: LeRobot's ``temporal_ensemble_coeff``; None takes the first action of every new chunk.
    """

    def __init__(self, student: Student, coefficient: float | None) -> None:
        self._student = student
        seen = observed_names(student.policy.config.input_features[OBS_STATE].shape[0])
        self._columns = [OBSERVATION_NAMES.index(name) for name in seen]
        size = student.policy.config.chunk_size
        self._ensembler = None if coefficient is None else ACTTemporalEnsembler(coefficient, size)

    def reset(self, count: int) -> None:
        """Forgets the chunks of earlier episodes."""
        if self._ensembler is not None:
            self._ensembler.reset()

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """(N, 13) float32 → N and N·m, (N, 6); a student of the camera's task is given its 6 values of them."""
        state = torch.from_numpy(observation[:, self._columns])
        batch = self._student.preprocessor({OBS_STATE: state, OBS_ENV_STATE: state})
        chunk = self._student.policy.predict_action_chunk(batch)
        action = chunk[:, 0] if self._ensembler is None else self._ensembler.update(chunk)
        return self._student.postprocessor(action).numpy().astype(np.float64)


def env_config(env_id: str, initial_conditions: str) -> SpaceDockConfig:
    """The environment of that id, as gymnasium makes it, without pictures."""
    return SpaceDockConfig(
        **ENV_IDS[env_id], env_id=env_id, initial_conditions=initial_conditions, obs_type="agent_pos"
    )


def evaluate(pilot: Any, config: SpaceDockConfig, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Flies one episode a seed and gives the metrics of each (``metrics.episode``)."""
    seeds = np.asarray(seeds)
    calm = Disturbance.draw(seeds, config.max_steps, KickConfig(), NoiseConfig())
    return [episode_metrics(log) for log in fly(pilot, config, seeds, calm)]
