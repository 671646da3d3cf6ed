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

from lerobot_spacedock.dataset.episode import log_of_rows
from lerobot_spacedock.dataset.provenance import read_dataset_facts, read_episode_rows, terminal_state
from lerobot_spacedock.dataset.statistics import column_array
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError

INDEX_COLUMNS = ("timestamp", "frame_index", "episode_index", "index", "task_index")
BATCH_ROWS = 4096


@dataclass(frozen=True)
class Episode:
    """One episode's rows.

    Attributes:
        index: of the episode.
        rows: columns by name, each (K, d); pictures are not among them.
        about: its row of ``provenance.EPISODES_FILE``, or nothing.
    """

    index: int
    rows: dict[str, np.ndarray]
    about: dict[str, Any]

    def log(self) -> EpisodeLog:
        """As an episode log; without a terminal state in the provenance it ends a step earlier."""
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
        self.info = _read_json(root / "meta" / "info.json")
        self.features: dict[str, dict[str, Any]] = self.info.get("features", {})
        self.facts = read_dataset_facts(root)
        self.about = read_episode_rows(root)
        self.episodes = self._read_episodes()

    @property
    def cameras(self) -> list[str]:
        return [name for name, feature in self.features.items() if feature["dtype"] in ("image", "video")]

    @property
    def lengths(self) -> list[int]:
        return [episode["length"] for episode in self.episodes]

    def iterate(self) -> Iterator[Episode]:
        """The episodes in order, one at a time, cut where ``episode_index`` changes.

        Raises:
            FileFormatError: a data file that cannot be read.
        """
        names = [name for name in self.features if name not in self.cameras]
        held: dict[str, list[np.ndarray]] | None = None
        current: int | None = None
        for batch in self._batches(names):
            index = batch["episode_index"][:, 0]
            cuts = np.flatnonzero(np.diff(index)) + 1
            for start, stop in zip([0, *cuts], [*cuts, len(index)], strict=True):
                if current is not None and index[start] != current:
                    yield self._episode(current, held)
                    held = None
                current = int(index[start])
                held = held or {name: [] for name in names}
                for name in names:
                    held[name].append(batch[name][start:stop])
        if current is not None:
            yield self._episode(current, held)

    def _episode(self, index: int, held: dict[str, list[np.ndarray]] | None) -> Episode:
        rows = {name: np.concatenate(parts) for name, parts in (held or {}).items()}
        about = self.about[index] if self.about is not None and 0 <= index < len(self.about) else {}
        return Episode(index, rows, about)

    def _batches(self, names: list[str]) -> Iterator[dict[str, np.ndarray]]:
        for path in sorted((self.root / "data").glob("chunk-*/file-*.parquet")):
            try:
                with pq.ParquetFile(path) as file:
                    missing = [name for name in names if name not in file.schema_arrow.names]
                    if missing:
                        raise FileFormatError(f"{path}: columns {missing} are missing.")
                    for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=names):
                        yield {name: column_array(batch.column(name)) for name in names}
            except (pa.ArrowException, OSError, ValueError) as error:
                if isinstance(error, FileFormatError):
                    raise
                raise FileFormatError(f"{path}: not a readable Parquet file ({error}).") from error

    def _read_episodes(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        for path in sorted((self.root / "meta" / "episodes").glob("chunk-*/file-*.parquet")):
            try:
                schema = pq.read_schema(path)
                names = [name for name in schema.names if not name.startswith("stats/")]
                found += pq.read_table(path, columns=names, partitioning=None).to_pylist()
            except (pa.ArrowException, OSError) as error:
                raise FileFormatError(f"{path}: not a readable Parquet file ({error}).") from error
        return sorted(found, key=lambda episode: episode["episode_index"])


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        raise FileFormatError(f"{path}: missing; this is not a LeRobotDataset v3.0.") from None
    except ValueError as error:
        raise FileFormatError(f"{path}: not JSON ({error}).") from error
    if not isinstance(content, dict):
        raise FileFormatError(f"{path}: {type(content).__name__}, not a JSON object.")
    return content
