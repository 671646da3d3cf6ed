"""Checks over the whole dataset: its sizes, and its statistics against the data."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.findings import Report, component, more
from lerobot_spacedock.dataset.reader import DatasetReader, Episode
from lerobot_spacedock.errors import reading

STATISTICS_TOLERANCE = 1e-4
NO_SPREAD = 1e-7  # of a channel's size: below it, normalised values are rounding errors


@dataclass
class Totals:
    """What sizes and statistics are compared with: lengths; of each column mean, spread and extremes, in float64."""

    count: int = 0
    lengths: list[int] = field(default_factory=list)
    last_task: int = -1
    least: dict[str, np.ndarray] = field(default_factory=dict)
    most: dict[str, np.ndarray] = field(default_factory=dict)
    first: dict[str, np.ndarray] = field(default_factory=dict)
    total: dict[str, np.ndarray] = field(default_factory=dict)
    squares: dict[str, np.ndarray] = field(default_factory=dict)

    def add(self, episode: Episode) -> None:
        self.count += len(episode.rows["index"])
        self.lengths.append(len(episode.rows["index"]))
        self.last_task = max(self.last_task, int(episode.rows["task_index"].max()))
        for name, values in episode.rows.items():
            if values.dtype.kind != "f":
                continue
            values = values.astype(np.float64)
            first = self.first.setdefault(name, values[0])
            self.least[name] = np.minimum(self.least.get(name, first), values.min(axis=0))
            self.most[name] = np.maximum(self.most.get(name, first), values.max(axis=0))
            deviation = values - first
            self.total[name] = self.total.get(name, 0.0) + deviation.sum(axis=0)
            self.squares[name] = self.squares.get(name, 0.0) + (deviation**2).sum(axis=0)

    def mean(self, name: str) -> np.ndarray:
        return self.first[name] + self.total[name] / self.count

    def std(self, name: str) -> np.ndarray:
        return np.sqrt(np.maximum(self.squares[name] / self.count - (self.total[name] / self.count) ** 2, 0.0))


def check_totals(reader: DatasetReader, totals: Totals, report: Report) -> None:
    """Compares the sizes that the metadata state with those of the data."""
    report.checks["totals"] += 1
    if not report.episodes and not reader.lengths.size:
        report.errors.append("no episode: there is nothing to learn from.")
    for name, found in (("total_episodes", report.episodes), ("total_frames", report.frames)):
        if reader.info.get(name) != found:
            report.errors.append(f"meta/info.json: {name} is {reader.info.get(name)}, the data hold {found}.")
    if len(reader.lengths) != report.episodes:
        report.errors.append(f"meta/episodes: {len(reader.lengths)} episodes, the data hold {report.episodes}.")
    if reader.lengths.sum() != report.frames:
        report.errors.append(f"meta/episodes: {reader.lengths.sum()} frames, the data hold {report.frames}.")
    _check_places(reader, totals, report)
    if reader.about is not None and len(reader.about) != report.episodes:
        report.errors.append(
            f"meta/spacedock_episodes.parquet: {len(reader.about)} rows for {report.episodes} episodes."
        )
    for name, count in report.unsure.items():
        report.warnings.append(
            f"{count} of {report.episodes} episodes: the next state does not follow from the command over the times "
            f"that were assumed: {name} off by up to {report.worst[name]:.3g}."
        )
    if reader.about is None:
        report.notes.append(
            "no provenance (meta/spacedock_episodes.parquet): the last step of each episode is unchecked."
        )
    lengths = reader.lengths
    median = float(np.median(lengths)) if lengths.size else 0.0
    odd = np.flatnonzero((lengths < 0.3 * median) | (lengths > 3.0 * median))
    whole = reader.facts.get("segment", "all") == "all"
    if odd.size and whole:
        report.warnings.append(
            f"episode {odd[0]}: {lengths[odd[0]]} frames, where the median is {median:g}{more(odd)}."
        )


def _check_places(reader: DatasetReader, totals: Totals, report: Report) -> None:
    """Compares where ``meta/episodes`` says that each episode lies, which LeRobot goes by, with the data."""
    ends = np.cumsum(totals.lengths, dtype=np.int64)
    if len(reader.lengths) == len(ends):
        for name, said, true in (
            ("length", reader.lengths, np.array(totals.lengths)),
            ("dataset_from_index", reader.listed_of_all("dataset_from_index"), ends - totals.lengths),
            ("dataset_to_index", reader.listed_of_all("dataset_to_index"), ends),
        ):
            bad = np.flatnonzero(said != true)
            if bad.size:
                where, given = f"meta/episodes, episode {bad[0]}", f"{name} is {said[bad[0]]}"
                report.errors.append(f"{where}: {given}, the data give {true[bad[0]]}{more(bad)}.")
        for camera in reader.cameras:
            if reader.features[camera]["dtype"] == "video":
                edges = (reader.listed_of_all(f"videos/{camera}/{edge}_timestamp") for edge in ("to", "from"))
                shown = np.rint(np.subtract(*edges) * reader.info["fps"]).astype(int)
                bad = np.flatnonzero(shown != totals.lengths)
                if bad.size:
                    given = f"{shown[bad[0]]} frames of {camera} for {totals.lengths[bad[0]]} rows"
                    report.errors.append(f"meta/episodes, episode {bad[0]}: {given}{more(bad)}.")
    path = reader.root / "meta" / "tasks.parquet"
    with reading(path, "the tasks of a dataset"):
        tasks = pq.read_metadata(path).num_rows if path.exists() else 0
    if totals.last_task >= tasks:
        report.errors.append(f"meta/tasks.parquet: {tasks} tasks, the data name task_index {totals.last_task}.")


def check_statistics(reader: DatasetReader, totals: Totals, report: Report) -> None:
    """Compares ``meta/stats.json``, quantiles apart, with the data; looks for what it leaves out and flat channels."""
    path = reader.root / "meta" / "stats.json"
    if not path.exists():
        report.errors.append("meta/stats.json: missing.")
        return
    with reading(path, "statistics"):
        _compare(reader, totals, json.loads(path.read_text()), report)


def _compare(reader: DatasetReader, totals: Totals, stats: dict[str, Any], report: Report) -> None:
    for name in (schema.STATE, schema.ACTION, *reader.cameras):
        if totals.count and name not in stats:
            report.errors.append(f"meta/stats.json: nothing on {name!r}, by which lerobot-train normalises.")
    known = ("mean", "std", "min", "max")
    for name in totals.first:
        if name == "timestamp" or name not in stats:
            continue
        report.checks["statistics"] += 1
        spread, mean = totals.std(name), totals.mean(name)
        scale = np.maximum(spread, np.finfo(np.float32).eps * np.maximum(np.abs(mean), 1e-12))
        written = {key: np.asarray(stats[name][key], dtype=np.float64).reshape(-1) for key in known}
        for key, true in zip(known, (mean, spread, totals.least[name], totals.most[name]), strict=True):
            bad = np.flatnonzero(np.abs(written[key] - true) > STATISTICS_TOLERANCE * scale + 1e-12)
            if bad.size:
                which = component(reader.features[name], name, bad[0])
                report.errors.append(
                    f"meta/stats.json: {key} of {which} is {written[key][bad[0]]:.6g}, "
                    f"the data give {true[bad[0]]:.6g}."
                )
        if name in (schema.STATE, schema.ACTION):
            flat = np.flatnonzero(spread <= NO_SPREAD * np.maximum(np.abs(mean), 1.0))
            if flat.size:
                listed = ", ".join(component(reader.features[name], name, i) for i in flat)
                report.warnings.append(
                    f"{listed}: no spread (std ≤ {NO_SPREAD:g}); a policy that normalises by it sees rounding errors, "
                    "and learns nothing of what it has to do there. Disturb the demonstrations, or start them wider."
                )
