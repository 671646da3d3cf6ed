"""States between the logged ones, for pictures that move evenly."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.metrics.crossing import hermite
from lerobot_spacedock.physics.frames import POSITION, QUATERNION, VELOCITY


def states_at(log: EpisodeLog, time: np.ndarray) -> np.ndarray:
    """States at any times within an episode: cubic Hermite in position and velocity, slerp in attitude.

    Args:
        log: the episode, (K+1) states.
        time: s, (N,), clipped to the episode.

    Returns:
        (N, 14), units as logged.
    """
    if log.num_steps == 0:
        return np.repeat(log.state[:1], len(time), axis=0)
    time = np.clip(time, log.time[0], log.time[-1])
    k = np.clip(np.searchsorted(log.time, time, side="right") - 1, 0, log.num_steps - 1)
    dt = np.maximum(log.time[k + 1] - log.time[k], 1e-9)[:, None]
    s = np.clip((time - log.time[k])[:, None] / dt, 0.0, 1.0)
    a, b = log.state[k], log.state[k + 1]
    out = a + s * (b - a)
    p0, v0, p1, v1 = a[:, POSITION], a[:, VELOCITY], b[:, POSITION], b[:, VELOCITY]
    out[:, POSITION], out[:, VELOCITY] = hermite(p0, v0, p1, v1, dt, s)
    out[:, QUATERNION] = slerp(a[:, QUATERNION], b[:, QUATERNION], s)
    return out


def slerp(p: np.ndarray, q: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Attitude between two, at constant rate, the short way. (N, 4), (N, 4), (N, 1) → (N, 4) unit."""
    cosine = np.sum(p * q, axis=1, keepdims=True)
    q, cosine = np.where(cosine < 0.0, -q, q), np.clip(np.abs(cosine), 0.0, 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    mixed = np.where(near, (1.0 - s) * p + s * q, (np.sin((1.0 - s) * angle) * p + np.sin(s * angle) * q) / safe)
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def dense(log: EpisodeLog, time: np.ndarray) -> EpisodeLog:
    """The episode with states at ``time`` and the command that was held there; its metadata kept."""
    k = np.clip(np.searchsorted(log.time, time, side="right") - 1, 0, max(0, log.num_steps - 1))
    action = log.action[k] if log.num_steps else np.zeros((len(time), 6))
    steps = np.diff(time)
    state = states_at(log, time)
    return EpisodeLog(time, state, action[:-1], steps, np.zeros(len(steps)), log.metadata)
