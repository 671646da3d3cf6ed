"""Real flights, and rollouts of other origin made from them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from PIL import Image

from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig
from lerobot_spacedock.dataset.flight import fly
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.expert.feedback import FeedbackPolicy
from lerobot_spacedock.physics.contact import get_port
from lerobot_spacedock.physics.frames import ACTION_NAMES, STATE_NAMES

HEIGHT, WIDTH = 48, 64


def make_env(env_id: str = "SpaceDockContact-v0", **options) -> SpaceDockConfig:
    return SpaceDockConfig.from_options(env_id=env_id, **(ENV_IDS[env_id] | options))


def fly_some(seeds, *, kicks: KickConfig | None = None, **env_options) -> list[EpisodeLog]:
    env = make_env(**env_options)
    seeds = np.asarray(seeds)
    disturbance = Disturbance.draw(seeds, env.max_steps, kicks or KickConfig(), NoiseConfig())
    law = FeedbackPolicy("V", port=get_port(env.port), hill_coupling=env.hill_coupling)
    return list(fly(law, env, seeds, disturbance))


def picture_of(step: int) -> np.ndarray:
    """A frame that says which step it is, and survives a lossy codec."""
    frame = np.full((HEIGHT, WIDTH, 3), 20 + 8 * step, dtype=np.uint8)
    frame[:, :, 2] = 235 - 8 * step
    return frame


def write_raw_export(folder: Path, logs: list[EpisodeLog], *, pictures: bool) -> None:
    """The authors' layout; the last row's command is there too, as theirs is."""
    (folder / "states").mkdir(parents=True)
    if pictures:
        (folder / "imgs").mkdir()
    for j, log in enumerate(logs):
        with (folder / "states" / f"trajectory_{j}.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(["time", *STATE_NAMES, *ACTION_NAMES])
            command = np.vstack([log.action, log.action[-1:]])
            for k in range(log.num_steps + 1):
                writer.writerow([repr(float(v)) for v in (log.time[k], *log.state[k], *command[k])])
        for k in range(log.num_steps + 1 if pictures else 0):
            Image.fromarray(picture_of(k)).save(folder / "imgs" / f"img_traj_{j}_step_{k}.png")


def short(log: EpisodeLog, steps: int) -> EpisodeLog:
    """The first steps of an episode."""
    return EpisodeLog(
        log.time[: steps + 1], log.state[: steps + 1], log.action[:steps], log.dt[:steps], log.reward[:steps],
        dict(log.metadata), {name: values[:steps] for name, values in log.extra.items()},
    )  # fmt: skip
