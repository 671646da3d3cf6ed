"""Flies an expert over many episodes at once and gives each as an episode log, its label beside what flew."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, Protocol

import numpy as np

from lerobot_spacedock import __version__
from lerobot_spacedock.dataset.disturbance import Disturbance
from lerobot_spacedock.dataset.episode import teaching_columns
from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.termination import DOCKED, RUNNING
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.physics.frames import ACTION_DIM, STATE_DIM, state_to_dataset_units


class FlyingPolicy(Protocol):
    """The part of an expert that is needed here."""

    def reset(self, count: int) -> None: ...

    def act(self, observation: np.ndarray) -> np.ndarray: ...


class _Tape:
    """What a batch of episodes leaves behind, step by step."""

    def __init__(self, count: int, steps: int) -> None:
        self.state = np.zeros((steps + 1, count, STATE_DIM))
        self.observed = np.zeros((steps, count, STATE_DIM - 1))
        self.label = np.zeros((steps, count, ACTION_DIM))
        self.action = np.zeros((steps, count, ACTION_DIM))
        self.dt = np.zeros((steps, count))
        self.reward = np.zeros((steps, count))
        self.length = np.zeros(count, dtype=np.int64)


def fly(
    policy: FlyingPolicy,
    config: SpaceDockConfig,
    seeds: np.ndarray,
    disturbance: Disturbance,
    *,
    metadata: dict[str, Any] | None = None,
) -> Iterator[EpisodeLog]:
    """Flies one episode a seed, all at once.

    Args:
        policy: acts on ``observation.state`` of all rows; what it commands, clipped, is the label.
        config: the environment; its camera is not used here.
        seeds: (N,).
        disturbance: added to the label before it flies, for the same seeds.
        metadata: goes into every log beside what the flight gives.

    Yields:
        The log of each episode, in the order of the seeds, with ``label_*`` columns, and ``observed_*`` columns
        where the sensors are not perfect.
    """
    sim = BatchedSpaceDock(len(seeds), config)
    limits = np.array([config.thrust_limit_N] * 3 + [config.torque_limit_Nm] * 3)
    tape = _Tape(len(seeds), config.max_steps)
    observation = sim.reset(seeds)
    policy.reset(len(seeds))
    endings: dict[int, dict[str, Any]] = {}
    for k in range(config.max_steps):
        running = sim.sim.code == RUNNING
        if not running.any():
            break
        tape.state[k], tape.observed[k] = state_to_dataset_units(sim.sim.state), observation
        tape.label[k] = np.clip(policy.act(observation), -limits, limits)
        result = sim.step(disturbance.add(tape.label[k], k, sim.sim.state))
        tape.action[k], tape.dt[k], tape.reward[k] = sim.sim.action, sim.sim.dt, result.reward
        tape.state[k + 1] = state_to_dataset_units(sim.sim.state)
        tape.length[running] += 1
        observation = result.observation
        for at, row in enumerate(result.ended):
            endings[int(row)] = {name: values[at].item() for name, values in result.report.items()}
    shared = {
        "version": __version__,
        "env_id": config.env_id,
        "config": asdict(config),
        "initial_conditions": config.initial_conditions,
        "label": config.label,
    }
    for row, seed in enumerate(seeds):
        outcome = sim.outcome(row, endings[row])
        own = {
            "seed": int(seed),
            "outcome": outcome,
            "success": outcome == DOCKED if config.contact else bool(endings[row]["idss"]),
            "contact": endings[row],
            "clipped_actions": int(sim.sim.clipped[row]),
            "dynamics": sim.dynamics(row),
        }
        yield _log_of(tape, row, config.dynamics == "meta", shared | (metadata or {}) | own)


def _log_of(tape: _Tape, row: int, imperfect_sensors: bool, metadata: dict[str, Any]) -> EpisodeLog:
    steps = int(tape.length[row])
    dt = tape.dt[:steps, row].copy()
    return EpisodeLog(
        time=np.concatenate([[0.0], np.cumsum(dt)]),
        state=tape.state[: steps + 1, row].copy(),
        action=tape.action[:steps, row].copy(),
        dt=dt,
        reward=tape.reward[:steps, row].copy(),
        metadata=metadata,
        extra=teaching_columns(
            label=tape.label[:steps, row], observed=tape.observed[:steps, row] if imperfect_sensors else None
        ),
    )
