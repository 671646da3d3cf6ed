"""Episode logs flown by a few lines of their own: double integrator without orbital terms, for tests of the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog, log_path, write_episode_log

NOMINAL = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])


def fly(seed: int, *, jitter: float = 0.0, gain: float = 1.0, steps: int | None = None, **metadata) -> EpisodeLog:
    """One approach: x and z to the axis, y to the port, with command noise of ``jitter`` newtons."""
    start = np.random.default_rng(seed)
    rng = np.random.default_rng([seed, int(jitter * 1000), int((gain + 10) * 1000)])
    count = steps if steps is not None else int(start.integers(61, 71))
    dt = np.clip(start.normal(0.907, 0.077, count), 0.6, 1.25)
    r = np.array([start.uniform(-1, 1), start.uniform(-26, -24), start.uniform(-1, 1)])
    v, mass = np.zeros(3), 1000.0
    states, actions = [], []
    for k in range(count):
        left = max(dt[k:].sum(), 4.0)
        acceleration = gain * (-6.0 * r / left**2 - 4.0 * v / left) if left > 4.0 else -0.5 * v
        thrust = np.clip(mass * acceleration + rng.normal(0, jitter, 3), -60, 60)
        body = np.array([thrust[0], -thrust[2], thrust[1]])  # H axes onto the nominal attitude's body axes
        states.append(np.concatenate([r, v, [mass], NOMINAL, np.zeros(3)]))
        actions.append(np.concatenate([body, rng.normal(0, 0.02 * (1 + jitter), 3)]))
        r = r + v * dt[k] + 0.5 * thrust / mass * dt[k] ** 2
        v = v + thrust / mass * dt[k]
        mass -= np.linalg.norm(thrust) * dt[k] / (300.0 * 9.81)
    states.append(np.concatenate([r, v, [mass], NOMINAL, np.zeros(3)]))
    meta = {"version": 1, "env_id": "SpaceDock-v0", "seed": seed, "initial_conditions": "same"} | metadata
    return EpisodeLog(
        time=np.concatenate([[0.0], np.cumsum(dt)]),
        state=np.array(states),
        action=np.array(actions).reshape(-1, 6),
        dt=dt,
        reward=-np.linalg.norm(np.array(states)[1:, :3], axis=1),
        metadata=meta,
    )


def write_run(folder: Path, seeds: range, **options) -> Path:
    """A folder of logs, one a seed."""
    for seed in seeds:
        write_episode_log(log_path(folder, seed), fly(seed, **options))
    return folder
