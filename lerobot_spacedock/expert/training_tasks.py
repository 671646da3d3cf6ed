"""The batched simulator as a source of whole episodes for recurrent PPO.

Every iteration flies one episode of a fixed number of steps in every environment, all from the start together:
nothing ends early (a policy that can end an episode learns to end it), sequences need no padding, the memory always
begins empty, and what is drawn depends on seed, iteration and row alone, so a resumed training needs no state of the
simulator.
The end of an episode is a cut, not an end: its last reward is given the critic's value of what would have followed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.reward import speed_profile
from lerobot_spacedock.env.scenario import SENSOR_NOISE
from lerobot_spacedock.expert.features import RATE_GAIN, VELOCITY_GAIN, actor_features
from lerobot_spacedock.expert.rsl import TensorDict
from lerobot_spacedock.expert.train_config import TrainExpertConfig
from lerobot_spacedock.physics import chaser as p
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.constants import CHASER_INERTIA_kg_m2, CHASER_MASS_kg, MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import ZVEZDA_AFT
from lerobot_spacedock.physics.frames import (
    ACTION_DIM,
    DEG_TO_RAD,
    MASS,
    OBSERVATION_INDICES,
    QUATERNION,
    RAD_TO_DEG,
    RATE,
    VELOCITY,
)

TRAINING_SEEDS_FROM = 2**48  # far from any seed that evaluations and demonstrations use
OVERDRIVE_COST = 0.05  # of reward per unit of command beyond the limits: keeps the output where it has an effect


class TrainingTasks:
    """Environments of every kind of task, stepped together.

    Args:
        config: of the training.
    """

    def __init__(self, config: TrainExpertConfig) -> None:
        self._config = config
        # the smoothness term is weighed here, where its weight can grow; nothing ends an episode, so no bonus
        reward = replace(config.reward, smoothness=0.0, terminal=0.0)
        self._batches, self._shoved = [], []
        for count, task in zip(config.environments(), config.tasks, strict=True):
            self._shoved.append(task.shoves)
            task_config = TaskConfig(
                initial_conditions=task.initial_conditions,
                dynamics=task.dynamics,
                hill_coupling=task.hill_coupling,
                max_steps=config.episode_steps,
                meta=config.meta,
                reward=reward,
            )
            self._batches.append(BatchedSpaceDock(count, task_config))
        self._coupled = np.concatenate(
            [np.full(batch.count, float(batch.config.hill_coupling)) for batch in self._batches]
        )
        self._distance, self._speed = speed_profile(config.reward).table()
        actor = config.actor
        self._scale = np.array([actor.thrust_scale_N] * 3 + [actor.torque_scale_Nm] * 3)
        self._limits = np.array([actor.thrust_limit_N] * 3 + [actor.torque_limit_Nm] * 3)
        self._nominal = torch.tensor(ZVEZDA_AFT.q_nominal, dtype=torch.float32)
        self._last = np.zeros((config.num_envs, ACTION_DIM))
        self._first = True
        self.smoothness_weight = config.reward.smoothness

    def reset(self, iteration: int) -> TensorDict:
        """Starts the episodes of ``iteration``; returns their first observations."""
        rng = np.random.default_rng([self._config.seed, iteration])
        seeds = TRAINING_SEEDS_FROM + rng.integers(0, 2**40, self._config.num_envs)
        self._shove_rng = rng
        at = 0
        for batch in self._batches:
            batch.reset(seeds[at : at + batch.count])
            at += batch.count
        self._last[:] = 0.0
        self._first = True
        return self._observe()

    def step(self, output: Tensor) -> tuple[TensorDict, Tensor]:
        """Flies the network's output (N, 6) for one step; returns observations and rewards (N,)."""
        output = output.cpu().numpy().astype(np.float64)
        wanted = output * self._scale
        command = np.clip(wanted, -self._limits, self._limits)
        at, rewards = 0, []
        for batch, shoved in zip(self._batches, self._shoved, strict=True):
            if shoved:
                self._shove(batch)
            rewards.append(batch.step(command[at : at + batch.count]).reward.copy())
            at += batch.count
        reward = np.concatenate(rewards)
        if not self._first:
            change = np.linalg.norm(command - self._last * self._scale, axis=1)
            reward -= self._config.reward.scale * self.smoothness_weight * change
        overdrive = np.maximum(np.abs(wanted) / self._limits - 1.0, 0.0).sum(axis=1)
        reward -= OVERDRIVE_COST * np.minimum(overdrive, 5.0)
        self._last, self._first = command / self._scale, False
        return self._observe(), torch.tensor(reward, dtype=torch.float32)

    def _shove(self, batch: BatchedSpaceDock) -> None:
        shoves, rng = self._config.shoves, self._shove_rng
        hit = (rng.random(batch.count) < shoves.probability)[:, None]
        dv, dw = rng.standard_normal((2, batch.count, 3))
        batch.sim.state[:, VELOCITY] += hit * shoves.velocity_m_s * dv
        batch.sim.state[:, RATE] += hit * shoves.rate_deg_s * DEG_TO_RAD * dw

    def _observe(self) -> TensorDict:
        last = torch.tensor(self._last, dtype=torch.float32)
        seen = torch.from_numpy(np.concatenate([batch.observe() for batch in self._batches]))
        state = np.concatenate([batch.sim.state for batch in self._batches])
        return TensorDict(
            {
                "actor": actor_features(seen, last, self._nominal),
                "critic": torch.cat([self._true_features(state, last), self._hidden()], dim=1),
            },
            batch_size=[len(seen)],
        )

    def _true_features(self, state: np.ndarray, last: Tensor) -> Tensor:
        true = state[:, OBSERVATION_INDICES].copy()
        true[:, 10:13] *= RAD_TO_DEG
        features = actor_features(torch.tensor(true, dtype=torch.float32), last, self._nominal)
        position, velocity = state[:, :3], state[:, VELOCITY]
        lag = velocity[:, 1] - np.interp(-position[:, 1], self._distance, self._speed)
        orbital = np.array([0.0, 0.0, MEAN_MOTION_rad_s]) * self._coupled[:, None]
        rate = state[:, RATE] - rotations.rotate_inverse(state[:, QUATERNION], orbital)
        extra = np.concatenate(
            [np.tanh(5.0 * position), 4.0 * VELOCITY_GAIN * np.clip(lag, -1.0, 1.0)[:, None], 2.0 * RATE_GAIN * rate],
            axis=1,
        )
        return torch.cat([features, torch.tensor(extra, dtype=torch.float32)], dim=1)

    def _hidden(self) -> Tensor:
        """What was drawn for the episode, of order one: the critic may know it, the actor has to find out."""
        parameters = np.concatenate([batch.sim.parameters for batch in self._batches])
        sensor = np.concatenate([batch.sim.sensor for batch in self._batches])
        mass = np.concatenate([batch.sim.state[:, MASS] for batch in self._batches])
        at = p.INERTIA
        hidden = [
            (mass / CHASER_MASS_kg - 1.0)[:, None],
            parameters[:, at : at + 9 : 4] / CHASER_INERTIA_kg_m2 - 1.0,
            parameters[:, p.THRUST_MAP : p.THRUST_MAP + 9] - np.eye(3).ravel(),
            parameters[:, p.TORQUE_MAP : p.TORQUE_MAP + 9 : 4] - 1.0,
            5.0 * parameters[:, p.TORQUE_BIAS : p.TORQUE_BIAS + 3],
            20.0 * parameters[:, p.COM_OFFSET : p.COM_OFFSET + 3],
            sensor[:, :SENSOR_NOISE] * np.repeat([20.0, 20.0, 100.0, 2000.0], 3),
            self._coupled[:, None],
        ]
        return torch.tensor(np.concatenate(hidden, axis=1), dtype=torch.float32)
