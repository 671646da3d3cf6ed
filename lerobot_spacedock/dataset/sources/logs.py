"""Episode logs as a source: what the environment, the demonstrations and the evaluations write."""

from __future__ import annotations

from pathlib import Path

from lerobot_spacedock.dataset.sources import EpisodeRef, LoadedEpisode
from lerobot_spacedock.episode_log import read_episode_log


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    return [EpisodeRef("logs", str(file), options=options) for file in sorted(path.glob("episode_*.parquet"))]


def load(ref: EpisodeRef) -> LoadedEpisode:
    return LoadedEpisode(read_episode_log(ref.path))
