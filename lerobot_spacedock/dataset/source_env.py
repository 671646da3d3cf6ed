"""What a source says of the environment that its flights and its pictures are of."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from lerobot_spacedock.dataset.sources import EpisodeRef, load
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError, InputError


def first_episode(refs: Iterable[EpisodeRef], *, pictures: bool) -> tuple[EpisodeLog | None, np.ndarray | None]:
    """The first episode that can be read, and its first picture, where it has any and they are wanted."""
    for ref in refs:
        with contextlib.suppress(FileFormatError):
            episode = load(ref)
            wanted = pictures and episode.frames is not None
            return episode.log, next(episode.frames(0), None) if wanted else None
    return None, None


def stated_env(log: EpisodeLog | None, inherited: dict[str, Any]) -> SpaceDockConfig | None:
    """The environment of the flights; None where the source says nothing.

    Args:
        log: an episode.
        inherited: what a source that is a dataset says of itself: that of its pictures, which the flight's own
            configuration need not know.
    """
    stated = readable(inherited.get("env") or (log.metadata.get("config") if log is not None else None))
    return None if stated is None else replace(stated, log_dir=None)


def pictured_env(inherited: dict[str, Any], port: str) -> SpaceDockConfig:
    """What is known of the pictures where nothing is known of the flights but their port."""
    drawing = inherited.get("drawing")
    stated = readable({**drawing, "port": port}) if isinstance(drawing, dict) else None
    return stated or SpaceDockConfig(port=port)


def readable(options: Any) -> SpaceDockConfig | None:
    """None of what another version, or anybody else, wrote."""
    if not isinstance(options, dict):
        return None
    try:
        return SpaceDockConfig.from_options(**options)
    except (InputError, TypeError):
        return None
