"""A LeRobotDataset v3.0 of this task as a source: to choose from it, to cut it, to scale or store its pictures anew.

Its only camera becomes ``observation.images.camera``, whatever it was called. Where the dataset keeps no state after
the last frame of an episode, that frame's state becomes the terminal one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.licence import stated_license
from lerobot_spacedock.dataset.reader import INDEX_COLUMNS, DatasetReader
from lerobot_spacedock.dataset.sources import (
    FURTHER,
    LAST_STATE,
    NO_LAST_STATE,
    NO_MASS,
    NO_REWARDS,
    EpisodeRef,
    LoadedEpisode,
    no_times,
)
from lerobot_spacedock.dataset.stored_episode import READ, DatasetEpisode
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import reading
from lerobot_spacedock.physics.constants import CHASER_MASS_kg
from lerobot_spacedock.physics.frames import MASS

INHERITED = ("env", "drawing", "expert", "first_seed", "disturbance")


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    return [EpisodeRef("lerobot", str(path), str(index), options) for index in range(len(DatasetReader(path).lengths))]


def load(ref: EpisodeRef) -> LoadedEpisode:
    episode = DatasetEpisode(Path(ref.path), int(ref.key))
    log = _completed(episode.log(), episode.features, float(ref.option("step_s") or 0.907))
    log = replace(
        log, metadata={name: log.metadata[name] for name in log.metadata if name != FURTHER} | _left_out(episode)
    )
    if log.num_steps < int(episode.place["length"]):
        log.metadata[LAST_STATE] = NO_LAST_STATE
    if not episode.cameras:
        return LoadedEpisode(log, tasks=episode.tasks())

    def frames(first: int) -> Iterator[np.ndarray]:
        return islice(episode.frames(), first, log.num_steps)

    return LoadedEpisode(log, frames, episode.tasks())


def inherited_facts(path: Path) -> dict[str, Any]:
    """What the source says of how it was made, and what is true of its pieces too."""
    facts = DatasetReader(path).facts
    found = {name: facts[name] for name in INHERITED if facts.get(name) is not None}
    found["license"] = stated_license(path)
    return found | ({"source_command": facts["command"]} if facts.get("command") else {})


def observed_options(path: Path) -> dict[str, bool]:
    """Whether the source's ``observation.state`` holds the mass, and no pose."""
    with reading(path, "a dataset"):
        names = schema.observed_names(*DatasetReader(path).features[schema.STATE]["shape"])
    return {"with_mass": "mass" in names, "withhold_pose": "x" not in names}


def _left_out(episode: DatasetEpisode) -> dict[str, str]:
    """What a log says of the columns that have no place in the schema: of cameras there is but one."""
    camera = episode.cameras[0] if len(episode.cameras) == 1 else schema.IMAGE
    known = {*READ, *INDEX_COLUMNS, schema.DONE, camera}
    left = [name for name in episode.features if name not in known]
    return {FURTHER: f"of the source left out: {', '.join(left)}"} if left else {}


def _completed(log: EpisodeLog, features: dict[str, Any], step_s: float) -> EpisodeLog:
    """The log with what the dataset has not got, said in its metadata as other sources say it."""
    said, state = {}, log.state
    if schema.CONTROL_DT not in features and schema.SIM_TIME not in features:
        said["times"] = no_times(step_s)
        log = replace(log, time=step_s * np.arange(log.num_steps + 1), dt=np.full(log.num_steps, step_s))
    if schema.REWARD not in features:
        said["rewards"] = NO_REWARDS
    if not np.isfinite(state[:, MASS]).all():
        said["mass"], state = NO_MASS, state.copy()
        state[:, MASS] = CHASER_MASS_kg
    return replace(log, state=state, metadata=log.metadata | said)
