"""Statistics of a written dataset, exact in float64.

LeRobot's running statistics are E[x²] - E[x]² in float32: a channel that hardly moves beside its size (a
mass of 999.53 … 1000 kg) loses its spread. Here the sums are of deviations from the first value, in
float64; files are read batch by batch, so that memory does not grow with the dataset.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.columns import iterate_columns
from lerobot_spacedock.errors import FileFormatError
from lerobot_spacedock.files import aside, write_json

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
HISTOGRAM_BINS = 1 << 16
EPISODES_AT_ONCE = 256


def vector_statistics(values: np.ndarray) -> dict[str, np.ndarray]:
    """Statistics of (n, d) values held in memory, under LeRobot's names, each (d,) but ``count`` (1,)."""
    values = np.asarray(values, dtype=np.float64)
    found = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values[0] + (values - values[0]).mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
    }
    return found | {name: np.quantile(values, q, axis=0) for name, q in QUANTILES.items()}


class StreamStatistics:
    """The same over batches, in two passes: ``update`` over all batches, then ``update_quantiles`` over all.

    Quantiles come from a histogram between the extremes: off by at most the range / 65,536.
    """

    def __init__(self) -> None:
        self.count = 0

    def update(self, batch: np.ndarray) -> None:
        batch = np.asarray(batch, dtype=np.float64)
        if self.count == 0:
            self.shift = batch[0].copy()
            self.sum = np.zeros_like(self.shift)
            self.sum_of_squares = np.zeros_like(self.shift)
            self.min, self.max = batch[0].copy(), batch[0].copy()
        deviation = batch - self.shift
        self.count += len(batch)
        self.sum += deviation.sum(axis=0)
        self.sum_of_squares += (deviation**2).sum(axis=0)
        self.min = np.minimum(self.min, batch.min(axis=0))
        self.max = np.maximum(self.max, batch.max(axis=0))

    def update_quantiles(self, batch: np.ndarray) -> None:
        if not hasattr(self, "histogram"):
            self.histogram = np.zeros((len(self.min), HISTOGRAM_BINS), dtype=np.int64)
        width = np.where(self.max > self.min, self.max - self.min, 1.0)
        bins = ((np.asarray(batch, dtype=np.float64) - self.min) / width * HISTOGRAM_BINS).astype(np.int64)
        for i, column in enumerate(np.clip(bins, 0, HISTOGRAM_BINS - 1).T):
            self.histogram[i] += np.bincount(column, minlength=HISTOGRAM_BINS)

    def result(self) -> dict[str, np.ndarray]:
        mean_deviation = self.sum / self.count
        variance = np.maximum(self.sum_of_squares / self.count - mean_deviation**2, 0.0)
        found = {
            "min": self.min,
            "max": self.max,
            "mean": self.shift + mean_deviation,
            "std": np.sqrt(variance),
            "count": np.array([self.count]),
        }
        cumulative = np.cumsum(self.histogram, axis=1) / self.count
        for name, q in QUANTILES.items():
            bins = np.array([np.searchsorted(row, q) for row in cumulative])
            found[name] = np.minimum(self.min + (bins + 0.5) / HISTOGRAM_BINS * (self.max - self.min), self.max)
        return found


def float_columns(root: Path) -> list[str]:
    """The dataset's floating-point features, whose statistics are recomputed here."""
    info = json.loads((root / "meta" / "info.json").read_text())
    return [
        name
        for name, feature in info["features"].items()
        if feature["dtype"] in ("float32", "float64") and len(feature["shape"]) == 1
    ]


def repair_statistics(root: Path | str) -> dict[str, dict[str, np.ndarray]]:
    """Recomputes the statistics of all float columns, of the dataset and of each episode, and writes them.

    Args:
        root: a finalised LeRobotDataset v3.0. ``meta/stats.json`` and the ``stats/…`` columns of
            ``meta/episodes`` are replaced, each file aside and renamed.

    Returns:
        The dataset's statistics by feature.
    """
    root = Path(root)
    names = float_columns(root)
    streams = {name: StreamStatistics() for name in names}
    for batch in iterate_columns(root, names):
        for name, values in batch.items():
            streams[name].update(values)
    for batch in iterate_columns(root, names):
        for name, values in batch.items():
            streams[name].update_quantiles(values)
    found = {name: stream.result() for name, stream in streams.items()}

    path = root / "meta" / "stats.json"
    stats = json.loads(path.read_text()) if path.exists() else {}
    for name, values in found.items():
        stats[name] = {key: value.tolist() for key, value in values.items()}
    write_json(path, stats, indent=4)
    _repair_episode_statistics(root, names)
    return found


def _repair_episode_statistics(root: Path, names: list[str]) -> None:
    rows = _RowBuffer(root, names)
    for path in sorted((root / "meta" / "episodes").glob("chunk-*/file-*.parquet")):
        with (
            pq.ParquetFile(path) as file,
            aside(path) as own,
            pq.ParquetWriter(own, file.schema_arrow, compression="snappy") as writer,
        ):
            for batch in file.iter_batches(batch_size=EPISODES_AT_ONCE):
                writer.write_table(_with_statistics(pa.Table.from_batches([batch]), rows, names))


def _with_statistics(table: pa.Table, rows: _RowBuffer, names: list[str]) -> pa.Table:
    """The metadata of some episodes with their ``stats/…`` columns replaced; takes their rows off the buffer."""
    per_episode = [
        {name: vector_statistics(values) for name, values in rows.take(length).items()}
        for length in table.column("length").to_pylist()
    ]
    for name in names:
        for key in ("min", "max", "mean", "std", "count", *QUANTILES):
            column = f"stats/{name}/{key}"
            if column not in table.column_names:
                continue
            field = table.schema.field(column)
            values = pa.array([stats[name][key].tolist() for stats in per_episode], field.type)
            table = table.set_column(table.column_names.index(column), field, values)
    return table


class _RowBuffer:
    """A buffer over ``iterate_columns`` from which whole episodes are taken in order."""

    def __init__(self, root: Path, names: list[str]) -> None:
        self.root, self.names = root, names
        self.batches = iterate_columns(root, names)
        self.buffer: dict[str, np.ndarray] | None = None

    def take(self, length: int) -> dict[str, np.ndarray]:
        """The next ``length`` rows of each column.

        Raises:
            FileFormatError: there are not so many.
        """
        parts: dict[str, list[np.ndarray]] = {name: [] for name in self.names}
        missing = length
        while missing > 0:
            if self.buffer is None or len(self.buffer[self.names[0]]) == 0:
                self.buffer = next(self.batches, None)
                if self.buffer is None:
                    raise FileFormatError(f"{self.root}: meta/episodes counts {missing} rows more than data/ holds.")
            for name in self.names:
                parts[name].append(self.buffer[name][:missing])
            taken = len(parts[self.names[0]][-1])
            self.buffer = {name: values[taken:] for name, values in self.buffer.items()}
            missing -= taken
        return {name: np.concatenate(part) for name, part in parts.items()}
