"""Readers of rollouts that exist already. Each module lists the episodes of a path and loads one of them."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lerobot_spacedock.dataset.episode import LABEL_COLUMNS, succeeded
from lerobot_spacedock.env.start import MAX_QUATERNION_ERROR
from lerobot_spacedock.episode_log import OBSERVED, EpisodeLog
from lerobot_spacedock.errors import FileFormatError, InputError, reading
from lerobot_spacedock.physics.frames import QUATERNION

FORMATS = {
    "logs": "episode logs: a folder of episode_*.parquet",
    "raw": "the authors' raw export: states/trajectory_*.csv and, if there are any, imgs/img_traj_*_step_*.png",
    "hdf5": "ACT-style episodes: a folder of episode_*.hdf5",
    "npz": "the same arrays as NumPy archives: a folder of episode_*.npz",
    "minari": "a Minari dataset: its folder, or its id among the local ones",
    "lerobot": "a LeRobotDataset v3.0 of this task, to choose from, cut or scale",
    "v21": "a LeRobotDataset v2.1 of the authors' schema, through LeRobot's own converter",
}

# what a log says under "times", "mass", "rewards", "readings", "chaser" and LAST_STATE where the source has none
LAST_STATE = "last state"
NO_LAST_STATE = "not in the source: the last row became it, and its command is left out"
NO_REWARDS = "not in the source: 0 stands in their place"
NO_READINGS = "of the imperfect sensors not in the source: the true state stands in their place"
NO_CHASER = "that was drawn not in the source: whether states follow from commands cannot be checked"
FURTHER = "further columns"  # the key of what there is no place for
BY_STATES = "the IDSS box; the source does not say"
NO_MASS = "not in the source: the nominal mass stands in its place"


@dataclass(frozen=True)
class EpisodeRef:
    """Where one episode is: small, picklable, and writable as JSON.

    Attributes:
        format: a key of ``FORMATS``.
        path: file or folder.
        key: which episode inside, where the path holds several.
        options: what its reader needs beside, as (name, value) pairs.
    """

    format: str
    path: str
    key: str = ""
    options: tuple[tuple[str, str | float | int | bool | None], ...] = ()

    @property
    def name(self) -> str:
        return f"{self.path}#{self.key}" if self.key else self.path

    @property
    def label(self) -> str:
        """What a dataset says of where an episode came from: the name without the folders above it."""
        name = Path(self.path).name
        return f"{name}#{self.key}" if self.key else name

    def option(self, name: str, default: str | float | int | bool | None = None) -> str | float | int | bool | None:
        return dict(self.options).get(name, default)

    def to_json(self) -> list:
        return [self.format, self.path, self.key, [list(pair) for pair in self.options]]

    @classmethod
    def from_json(cls, values: list) -> EpisodeRef:
        return cls(values[0], values[1], values[2], tuple((name, value) for name, value in values[3]))


@dataclass(frozen=True)
class LoadedEpisode:
    """One episode in memory.

    Attributes:
        log: states, commands, times.
        frames: ``frames(first)`` yields the stored pictures from step ``first`` on, one a step; None where the source
            has none and they have to be drawn.
        tasks: what each step is said to do; None where the source does not say.
    """

    log: EpisodeLog
    frames: Callable[[int], Iterator[np.ndarray]] | None = None
    tasks: list[str] | None = None


def no_times(step_s: float) -> str:
    return f"not in the source: {step_s:g} s a step"


def list_episodes(kind: str, path: Path | str, **options: str | float | int | bool | None) -> list[EpisodeRef]:
    """The episodes of a path, in order.

    Raises:
        InputError: unknown format, or a path in which there is none.
    """
    if kind not in FORMATS or kind == "v21":
        raise InputError("--format", kind, " | ".join(FORMATS))
    path = Path(path)
    if kind != "minari" and not path.is_dir():
        raise InputError("--source", str(path), f"an existing folder holding {FORMATS[kind]}")
    found = _module(kind).list_episodes(path, tuple(sorted(options.items())))
    if not found:
        raise InputError("--source", str(path), f"a folder holding {FORMATS[kind]}", "None was found there.")
    return found


def load(ref: EpisodeRef) -> LoadedEpisode:
    """Reads one episode; every problem is a FileFormatError that names the file and the place.

    Where the source does not say whether it docked, its states are judged by the IDSS box, at the port that it names,
    or else at the one of the option ``port``.

    Raises:
        InputError: the source names another port than that option.
    """
    try:
        episode = _module(ref.format).load(ref)
        _check_attitudes(ref, episode.log)
        _check_teaching(ref, episode.log)
        with reading(ref.name, "an episode"):
            return replace(episode, log=_judged(_at_port(ref, episode.log)))
    except FileNotFoundError as error:
        raise FileFormatError(f"{error.filename or ref.name}: missing.") from error
    except (OSError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{ref.name}: not readable ({error}).") from error


def _at_port(ref: EpisodeRef, log: EpisodeLog) -> EpisodeLog:
    asked = ref.option("port")
    config = log.metadata.get("config")
    stated = log.metadata.get("port") or (config.get("port") if isinstance(config, dict) else None)
    if asked and stated and asked != stated:
        raise InputError("--port", asked, f"{stated}, which {ref.label} names", "Leave it out.")
    return replace(log, metadata=log.metadata | {"port": asked}) if asked and not stated else log


def _judged(log: EpisodeLog) -> EpisodeLog:
    said = {name: log.metadata[name] for name in log.metadata if name != "success"}
    if log.metadata.get("success") is not None and "success_by" not in said:
        return log
    judged = {"success": succeeded(replace(log, metadata=said)), "success_by": BY_STATES}
    return replace(log, metadata=said | judged)


def _check_attitudes(ref: EpisodeRef, log: EpisodeLog) -> None:
    length = np.linalg.norm(log.state[:, QUATERNION], axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1.0) < MAX_QUATERNION_ERROR))
    if wrong.size:
        row = wrong[0]
        raise FileFormatError(f"{ref.name}: the quaternion of state {row} has the length {length[row]:.3g}, not 1.")


def _check_teaching(ref: EpisodeRef, log: EpisodeLog) -> None:
    """What becomes the observation or the label is a number, and a label has all its components or none."""
    labels = [name for name in LABEL_COLUMNS if name in log.extra]
    if labels and len(labels) < len(LABEL_COLUMNS):
        raise FileFormatError(f"{ref.name}: of the label only {', '.join(labels)}; all six are needed, or none.")
    for name in (*labels, *(name for name in log.extra if name.startswith(OBSERVED))):
        bad = np.flatnonzero(~np.isfinite(log.extra[name][: log.num_steps]))
        if bad.size:
            raise FileFormatError(f"{ref.name}: column {name!r} holds {log.extra[name][bad[0]]} in row {bad[0]}.")


def _module(kind: str):
    return importlib.import_module(
        f"lerobot_spacedock.dataset.sources.{ {'npz': 'arrays', 'hdf5': 'arrays'}.get(kind, kind) }"
    )
