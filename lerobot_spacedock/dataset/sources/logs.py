"""Episode logs as a source: what the environment, the demonstrations and the evaluations write."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lerobot_spacedock.dataset.sources import NO_READINGS, EpisodeRef, LoadedEpisode
from lerobot_spacedock.episode_log import OBSERVED, read_episode_log


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    return [EpisodeRef("logs", str(file), options=options) for file in sorted(path.glob("episode_*.parquet"))]


def load(ref: EpisodeRef) -> LoadedEpisode:
    log = read_episode_log(ref.path)
    config = log.metadata.get("config")
    imperfect = isinstance(config, dict) and config.get("dynamics") == "meta"
    if imperfect and not any(name.startswith(OBSERVED) for name in log.extra):
        log = replace(log, metadata=log.metadata | {"readings": NO_READINGS})
    return LoadedEpisode(log)
