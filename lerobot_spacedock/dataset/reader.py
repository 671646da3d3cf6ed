"""Reads a LeRobotDataset v3.0 from its files, episode by episode, in flat memory: no index of frames, no torch."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.columns import iterate_columns
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.episode import log_of_rows
from lerobot_spacedock.dataset.provenance import (
    EpisodeRows,
    episode_rows,
    first_row,
    read_dataset_facts,
    terminal_state,
)
from lerobot_spacedock.episode_log import MAX_STATES, EpisodeLog
from lerobot_spacedock.errors import FileFormatError, reading
from lerobot_spacedock.files import read_object

INDEX_COLUMNS = ("timestamp", "frame_index", "episode_index", "index", "task_index")


@dataclass(frozen=True)
class Episode:
    """One episode's rows.

    Attributes:
        index: of the episode.
        rows: columns by name, each (K, d); pictures are not among them.
        about: its row of ``provenance.EPISODES_FILE``, or nothing.
        root: folder of the dataset.
    """

    index: int
    rows: dict[str, np.ndarray]
    about: dict[str, Any]
    root: Path

    def log(self) -> EpisodeLog:
        """As an episode log; without a terminal state in the provenance it ends a step earlier."""
        with reading(f"{self.root}, episode {self.index}", "an episode"):
            metadata = json.loads(self.about["metadata"]) if self.about else {}
            end = terminal_state(self.about) if self.about else None
            return log_of_rows(self.rows, terminal_state=end, metadata=metadata)


class DatasetReader:
    """The files of one dataset.

    Args:
        root: its folder.

    Raises:
        FileFormatError: ``meta/info.json`` or the episodes' metadata cannot be read.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.info = _read_info(root)
        with reading(root / "meta", "a dataset's metadata"):
            self.features: dict[str, dict[str, Any]] = dict(self.info.get("features", {}))
            self.facts = read_dataset_facts(root)
            self.about = episode_rows(root)
            self._list_episodes()

    @property
    def has_pose(self) -> bool:
        """Whether position and attitude stand in some column."""
        return schema.TRUE_STATE in self.features or "x" in schema.observed_names(*self.features[schema.STATE]["shape"])

    @property
    def cameras(self) -> list[str]:
        return [name for name, feature in self.features.items() if feature["dtype"] in ("image", "video")]

    def listed(self, index: int) -> dict[str, Any]:
        """What ``meta/episodes`` says of one episode, statistics apart.

        Raises:
            FileFormatError: it is not in there.
        """
        for path, indices in self.files.items():
            if index in indices:
                return first_row(path, index, leave_out="stats/") or {}
        raise FileFormatError(f"{self.root / 'meta' / 'episodes'}: episode {index} is not listed.")

    def listed_of_all(self, name: str) -> np.ndarray:
        """One value an episode of ``meta/episodes``, in the order of the episodes.

        Raises:
            FileFormatError: there is no such column.
        """
        none = np.zeros(0, dtype=np.int64)
        order = np.argsort(np.concatenate([none, *self.files.values()]), kind="stable")
        return np.concatenate([none, *(self._listed_column(path, name) for path in self.files)])[order]

    def iterate(self) -> Iterator[Episode]:
        """The episodes in order, one at a time, cut where ``episode_index`` changes.

        Raises:
            FileFormatError: a data file that cannot be read.
        """
        with reading(self.root / "data", "a dataset"):
            yield from self._iterate()

    def _iterate(self) -> Iterator[Episode]:
        names = [name for name in self.features if name not in self.cameras]
        held: dict[str, list[np.ndarray]] | None = None
        current: int | None = None
        about = _Cursor(self.about)
        for batch in iterate_columns(self.root, names):
            index = batch["episode_index"][:, 0]
            cuts = np.flatnonzero(np.diff(index)) + 1
            for start, stop in zip([0, *cuts], [*cuts, len(index)], strict=True):
                if current is not None and index[start] != current:
                    yield _episode(self.root, current, held, about)
                    held = None
                current = int(index[start])
                held = held or {name: [] for name in names}
                for name in names:
                    held[name].append(batch[name][start:stop])
                if sum(map(len, held["episode_index"])) > MAX_STATES:
                    raise FileFormatError(f"{self.root / 'data'}: episode {current} has more than {MAX_STATES:,} rows.")
        if current is not None:
            yield _episode(self.root, current, held, about)

    def _list_episodes(self) -> None:
        """The indices in each file of ``meta/episodes``; and the lengths in the order of the episodes."""
        paths = sorted((self.root / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
        self.files: dict[Path, np.ndarray] = {path: self._listed_column(path, "episode_index") for path in paths}
        self.lengths = self.listed_of_all("length")

    @staticmethod
    def _listed_column(path: Path, name: str) -> np.ndarray:
        try:
            return pq.read_table(path, columns=[name], partitioning=None).column(name).to_numpy()
        except (pa.ArrowException, OSError, KeyError) as error:
            raise FileFormatError(f"{path}: not a readable Parquet file with {name!r} ({error}).") from error


class _Cursor:
    """Goes through ``EpisodeRows`` along with the episodes."""

    def __init__(self, rows: EpisodeRows | None) -> None:
        self.rows = iter(rows) if rows is not None else iter(())
        self.row: dict[str, Any] = {"episode_index": -1}

    def at(self, index: int) -> dict[str, Any]:
        """The row of an episode after those asked for before; empty where there is none."""
        while self.row and self.row["episode_index"] < index:
            self.row = next(self.rows, {})
        return self.row if self.row and self.row["episode_index"] == index else {}


def _episode(root: Path, index: int, held: dict[str, list[np.ndarray]] | None, about: _Cursor) -> Episode:
    rows = {name: np.concatenate(parts) for name, parts in (held or {}).items()}
    return Episode(index, rows, about.at(index), root)


def _read_info(root: Path) -> dict[str, Any]:
    path = root / "meta" / "info.json"
    if not path.is_file():
        raise FileFormatError(f"{path}: missing; this is not a LeRobotDataset v3.0.")
    return read_object(path)
