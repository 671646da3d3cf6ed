"""Minari datasets recorded from these environments (or of the same layout).

Observations are the environment's own: ``agent_pos``, and ``pixels`` → ``camera`` where the recording kept them; or one
array of states. Times and true states are taken from the infos that the environment gives (``time_s``, ``state``),
where the recording kept those; what the policy saw of imperfect sensors then stands beside the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset.episode import reading_columns
from lerobot_spacedock.dataset.sources import EpisodeRef, LoadedEpisode
from lerobot_spacedock.dataset.sources.arrays import log_of_arrays
from lerobot_spacedock.errors import FileFormatError, InputError, MissingDependencyError, reading


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    dataset = _open(str(path))
    return [EpisodeRef("minari", str(path), str(index), options) for index in dataset.episode_indices]


def load(ref: EpisodeRef) -> LoadedEpisode:
    episode = next(iter(_open(ref.path).iterate_episodes([int(ref.key)])))
    observations, infos = episode.observations, episode.infos or {}
    states = observations.get("agent_pos") if isinstance(observations, dict) else observations
    if not isinstance(states, np.ndarray):
        raise FileFormatError(f"{ref.name}: no 'agent_pos' among the observations.")
    true = np.asarray(infos["state"]) if "state" in infos else states
    success = infos.get("is_success")
    log = log_of_arrays(
        ref.name,
        state=true,
        action=np.asarray(episode.actions),
        time=infos.get("time_s"),
        reward=np.asarray(episode.rewards),
        step_s=float(ref.option("step_s") or 0.907),
        metadata={
            "source": "minari",
            "success": None if success is None else bool(np.asarray(success)[-1]),
            "seed": _seed(episode),
        },
    )
    if true is not states:
        with reading(ref.name, "an episode"):
            log = replace(log, extra=reading_columns(states[: log.num_steps], log.state[:-1]))
    pictures = _pictures(observations)
    if pictures is None:
        return LoadedEpisode(log)

    def frames(first: int) -> Iterator[np.ndarray]:
        return iter(pictures[first : log.num_steps])

    return LoadedEpisode(log, frames)


def _pictures(observations: Any) -> np.ndarray | None:
    if not isinstance(observations, dict) or "pixels" not in observations:
        return None
    pixels = observations["pixels"]
    return pixels["camera"] if isinstance(pixels, dict) else pixels


def _seed(episode: Any) -> int | None:
    seed = getattr(episode, "seed", None)
    return int(seed) if isinstance(seed, int | np.integer) else None


def _open(path: str) -> Any:
    try:
        import minari
    except ImportError as error:
        raise MissingDependencyError("minari is needed: pip install '.[minari]' in SpaceDock's folder") from error
    try:
        if Path(path).is_dir():
            data = Path(path) / "data"
            return minari.MinariDataset(data if data.is_dir() else Path(path))
        return minari.load_dataset(path)
    except (FileNotFoundError, ValueError, OSError, KeyError) as error:
        raise InputError(
            "--source", path, "a Minari dataset: its folder, or the id of a local one", str(error)
        ) from error
