"""What ``spacedock sweep`` wrote, read again; anybody may have made such a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import InputError, reading

COUNTS = ("episodes", "idss", "contact")
AMOUNTS = (("distance_m", "mean"), ("distance_m", "p95"), ("smoothness", "mean"))


def read_trials(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """The trials of result files, in order; figures and tables may rely on what is checked here.

    Raises:
        InputError: no file was named, or one is not there.
        FileFormatError: one is no result of a sweep.
        InputError: the same trial twice, which would pass for another training seed.
    """
    if not paths:
        raise InputError("--results", "nothing", "one JSON file or more, as spacedock sweep writes them")
    trials = []
    for path in paths:
        if not path.is_file():
            raise InputError("--results", str(path), "an existing file")
        with reading(path, "a result of spacedock sweep"):
            found = json.loads(path.read_text(encoding="utf-8"))["trials"]
            for trial in found:
                check_point(trial["point"])
                for row in trial["rows"]:
                    check_row(row)
        trials += found
    seen: dict[str, None] = {}
    for trial in trials:
        point = json.dumps(trial["point"], sort_keys=True)
        if point in seen:
            raise InputError("--results", f"twice the trial {point}", "files whose trials differ")
        seen[point] = None
    return trials


def check_point(point: Mapping[str, Any]) -> None:
    """Raises ValueError, KeyError or TypeError where a trial's settings are not names with one plain value each."""
    for name, kind in (("seed", int), ("chunk_size", int), ("demonstrations", str)):
        if type(point[name]) is not kind:
            raise ValueError(f"{name} {point[name]!r}")
    for name, value in point.items():
        if not isinstance(value, str | int | float | None):
            raise ValueError(f"{name} {value!r}")


def check_row(row: Mapping[str, Any]) -> None:
    """Raises ValueError, KeyError or TypeError where one task's summary lacks a number, or has something else there."""
    if not isinstance(row["task"], str):
        raise ValueError(f"task {row['task']!r}")
    if row["coefficient"] is not None:
        float(row["coefficient"] + 0.0)
    counts = [row[name] for name in COUNTS]
    if any(type(count) is not int for count in counts) or not 0 <= max(counts[1:]) <= counts[0] or counts[0] == 0:
        raise ValueError(f"{', '.join(COUNTS)}: {counts!r}")
    for name, statistic in AMOUNTS:
        value = row[name][statistic]
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} {statistic} {value!r}")
    median = row["closing_m_s"]["median"]
    if median is not None and not math.isfinite(median):
        raise ValueError(f"closing_m_s median {median!r}")


def per_seed(rows: Sequence[Mapping[str, Any]], cell: Callable[[Mapping[str, Any]], str]) -> str:
    """A table's cell: a value a row (a training seed), or the one that all of them share."""
    found = [cell(row) for row in rows]
    return found[0] if len(set(found)) == 1 else " / ".join(found)


def cm(distance_m: float) -> str:
    """Centimetres, to the millimetre below a metre."""
    return f"{100.0 * distance_m:.{1 if distance_m < 1.0 else 0}f}"
