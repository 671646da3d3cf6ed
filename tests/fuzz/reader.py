"""What a reader is to the fuzzer, and the episode that good files are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import SpaceDockError
from lerobot_spacedock.physics.frames import OBSERVATION_INDICES

STEPS = 6
Mutation = Callable[[np.random.Generator, bytes], bytes]


@dataclass(frozen=True)
class Reader:
    """One row of the table.

    Attributes:
        name: what is read.
        make: writes good files into a folder; returns those that get mutated, each with what keeps its framing whole
            (None: bytes only).
        read: what is called with the mutated file.
        allowed: what it may raise.
        needs: optional modules.
        framed: bytes changed anywhere would say nothing; only mutations that keep the framing.
        loopback: it may connect to this machine, where its own hub is.
    """

    name: str
    make: Callable[[Path], list[tuple[Path, Mutation | None]]]
    read: Callable[[Path], object]
    allowed: tuple[type[BaseException], ...] = (SpaceDockError,)
    needs: tuple[str, ...] = ()
    framed: bool = False
    loopback: bool = False


def an_episode(seed: int = 0) -> EpisodeLog:
    """A short flight as the environment logs it."""
    rng = np.random.default_rng(seed)
    state = np.zeros((STEPS + 1, 14))
    state[:, 1], state[:, 6] = np.linspace(-3.0, 0.2, STEPS + 1), 1000.0
    state[:, 7:11] = (0.5**0.5, -(0.5**0.5), 0.0, 0.0)
    about = {
        "env_id": "SpaceDock-v0",
        "seed": seed,
        "initial_conditions": "same",
        "clipped_actions": 0,
        "success": True,
    }
    about |= {"config": {"port": "zvezda_aft", "corridor": {"half_angle_deg": 10.0, "mouth_radius_m": 1.5}}}
    about |= {"inference": {"batch": 2, "warm_up_steps": 1}}
    dt = np.full(STEPS, 0.9)
    time = np.concatenate([[0.0], np.cumsum(dt)])
    extra = {"inference_s": rng.uniform(0.01, 0.02, STEPS)}
    return EpisodeLog(time, state, rng.normal(0, 5, (STEPS, 6)), dt, np.zeros(STEPS), about, extra)


def some_arrays() -> dict[str, np.ndarray]:
    log = an_episode()
    images = np.random.default_rng(0).integers(0, 256, (STEPS, 4, 6, 3), dtype=np.uint8)
    return {"state": log.state[:-1][:, OBSERVATION_INDICES], "action": log.action, "dt": log.dt, "images": images}
