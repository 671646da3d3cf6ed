"""How a dataset was made, kept inside it: ``meta/spacedock.json``, and one row an episode in Parquet.

LeRobot reads neither and its tools may drop them; whoever reads them here can do without.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock import __version__
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError
from lerobot_spacedock.files import read_object
from lerobot_spacedock.physics.frames import STATE_NAMES

DATASET_FILE = "meta/spacedock.json"
EPISODES_FILE = "meta/spacedock_episodes.parquet"
TERMINAL_COLUMNS = tuple(f"terminal_{name}" for name in STATE_NAMES)
ROWS_AT_ONCE = 256
PACKAGES = ("lerobot", "numpy", "numba", "torch", "datasets", "av")


def versions() -> dict[str, str]:
    """Version of this package and of those that shape the data."""
    found = {"lerobot_env_spacedock": __version__, "python": sys.version.split()[0]}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def episode_row(log: EpisodeLog, *, source: str, repeat: int = 0) -> dict[str, Any]:
    """What ``EPISODES_FILE`` keeps of one episode.

    Args:
        log: the episode as written, after cutting.
        source: where it came from.
        repeat: how many times this piece was written before.
    """
    seed = log.metadata.get("seed")
    terminal = dict(zip(TERMINAL_COLUMNS, (float(v) for v in log.state[-1]), strict=True))
    return {
        "length": log.num_steps,
        "source": source,
        "repeat": repeat,
        "seed": seed if isinstance(seed, int) and 0 <= seed < 2**64 else None,
        "initial_conditions": str(log.metadata.get("initial_conditions") or ""),
        "outcome": str(log.metadata.get("outcome") or ""),
        "success": bool(log.metadata.get("success", False)),
        "segment_first_step": int(log.metadata.get("segment_first_step", 0)),
        "metadata": json.dumps(log.metadata),
        **terminal,
    }


def write_episode_rows(root: Path, parts: Iterable[list[dict[str, Any]]]) -> None:
    """Writes ``EPISODES_FILE``, part by part; the row's place is the episode's index."""
    count, writer = 0, None
    try:
        for rows in parts:
            if not rows:
                continue
            columns = {"episode_index": list(range(count, count + len(rows)))}
            columns |= {name: [row[name] for row in rows] for name in rows[0]}
            table = pa.table({name: _array(name, values) for name, values in columns.items()})
            writer = writer or pq.ParquetWriter(root / EPISODES_FILE, table.schema, compression="zstd")
            writer.write_table(table)
            count += len(rows)
    finally:
        if writer is not None:
            writer.close()


class EpisodeRows:
    """``EPISODES_FILE``, of which only some rows at a time are in memory; in the order of the episodes.

    Raises:
        FileFormatError: the file is there and is not readable, or holds an episode twice.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._reading(), pq.ParquetFile(path) as file:
            self.count = file.metadata.num_rows

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[dict[str, Any]]:
        last = -1
        with self._reading(), pq.ParquetFile(self.path) as file:
            for batch in file.iter_batches(batch_size=ROWS_AT_ONCE):
                for row in batch.to_pylist():
                    if row["episode_index"] <= last:
                        raise FileFormatError(
                            f"{self.path}: episode {row['episode_index']} comes after episode {last}."
                        )
                    last = row["episode_index"]
                    yield row

    def row(self, index: int) -> dict[str, Any] | None:
        """One episode's, found by its index; None where there is none."""
        with self._reading():
            return first_row(self.path, index)

    def column(self, name: str) -> np.ndarray:
        """One value an episode."""
        with self._reading():
            return pq.read_table(self.path, columns=[name], partitioning=None).column(name).to_numpy()

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except (pa.ArrowException, OSError, KeyError) as error:
            raise FileFormatError(f"{self.path}: not a readable Parquet file ({error}).") from error


def first_row(path: Path, episode: int, leave_out: str | None = None) -> dict[str, Any] | None:
    """An episode's row of a Parquet file, or None; however many a damaged file holds, a few at a time are read.

    Args:
        path: a file with a column ``episode_index``.
        episode: its index.
        leave_out: columns whose names begin so are not read.
    """
    with pq.ParquetFile(path) as file:
        names = [name for name in file.schema_arrow.names if leave_out is None or not name.startswith(leave_out)]
        for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=names):
            found = np.flatnonzero(batch.column("episode_index").to_numpy(zero_copy_only=False) == episode)
            if found.size:
                return batch.slice(found[0], 1).to_pylist()[0]
    return None


def episode_rows(root: Path) -> EpisodeRows | None:
    """What ``EPISODES_FILE`` says, or None where the dataset has none."""
    path = root / EPISODES_FILE
    return EpisodeRows(path) if path.exists() else None


def terminal_state(row: dict[str, Any]) -> np.ndarray:
    return np.array([row[name] for name in TERMINAL_COLUMNS])


def write_dataset_facts(root: Path, facts: dict[str, Any], columns: dict[str, schema.Column]) -> None:
    """Writes ``DATASET_FILE``: the schema's version, the columns with units and meaning, and ``facts``."""
    described = {
        name: {"names": list(c.names), "units": list(c.units), "meaning": c.meaning} for name, c in columns.items()
    }
    content = {"schema_version": schema.SCHEMA_VERSION, "versions": versions(), **facts, "columns": described}
    (root / DATASET_FILE).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def read_dataset_facts(root: Path) -> dict[str, Any]:
    """``DATASET_FILE``, or nothing where the dataset has none."""
    path = root / DATASET_FILE
    if not path.exists():
        return {}
    return read_object(path)


def _array(name: str, values: list) -> pa.Array:
    kinds = {
        "episode_index": pa.int64(),
        "length": pa.int64(),
        "repeat": pa.int64(),
        "seed": pa.uint64(),
        "segment_first_step": pa.int64(),
        "success": pa.bool_(),
        "source": pa.string(),
        "initial_conditions": pa.string(),
        "outcome": pa.string(),
        "metadata": pa.string(),
    }
    return pa.array(values, kinds.get(name, pa.float64()))
