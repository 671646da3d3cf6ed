"""``python -m lerobot_spacedock.study.table results/sweep_NAME.json``: what a sweep found, in Markdown.

A line a setting; a cell has one value a training seed, in their order; what all trials share is left out.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.report.table import percent
from lerobot_spacedock.study.results import cm, per_seed, read_trials

Rows = dict[tuple[Any, ...], list[dict[str, Any]]]


def group(
    trials: list[dict[str, Any]], tasks: Sequence[str] = (), coefficients: Sequence[float] = ()
) -> tuple[list[str], Rows]:
    """The axes that vary (the seed aside), and the rows of all seeds by their values, task and coefficient.

    Args:
        trials: as ``read_trials`` gives them.
        tasks: keep these alone; none keeps all.
        coefficients: keep these alone; none keeps all.

    Raises:
        InputError: no trial, or a task or a coefficient that none was flown with.
    """
    flown = [row for trial in trials for row in trial["rows"]]
    if not flown:
        raise InputError("results", "no trial", "files with one at least", "Let spacedock sweep finish one first.")
    _check("--tasks", tasks, {row["task"] for row in flown})
    _check("--coefficients", coefficients, {row["coefficient"] for row in flown} - {None})
    names = list(trials[0]["point"])
    vary = [name for name in names if name != "seed" and len({trial["point"].get(name) for trial in trials}) > 1]
    found: Rows = defaultdict(list)
    for trial in sorted(trials, key=lambda trial: trial["point"]["seed"]):
        for row in trial["rows"]:
            if (not tasks or row["task"] in tasks) and (not coefficients or row["coefficient"] in coefficients):
                key = (*(trial["point"].get(name) for name in vary), row["task"], row["coefficient"])
                found[key].append(row)
    return vary, found


def _check(flag: str, wanted: Sequence[Any], flown: set[Any]) -> None:
    for value in wanted:
        if value not in flown:
            raise InputError(flag, value, " | ".join(map(str, sorted(flown))))


def table(trials: list[dict[str, Any]], tasks: Sequence[str] = (), coefficients: Sequence[float] = ()) -> str:
    """The Markdown table."""
    vary, found = group(trials, tasks, coefficients)
    head = [*(name.replace("_", " ") for name in vary), "task", "coefficient"]
    head += ["docked, %", "reached the plane, %", "distance mean, cm", "p95, cm", "closing speed, m/s", "smoothness"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    order = {key: place for place, key in enumerate(found)}
    numbers = [place for place, name in enumerate(vary) if all(isinstance(key[place], int | float) for key in found)]
    for key in sorted(found, key=lambda key: (*(key[place] for place in numbers), order[key])):
        rows = found[key]
        *values, task, coefficient = key
        cells = [str(value) for value in values] + [task, "newest" if coefficient is None else f"{coefficient:+g}"]
        cells += [
            per_seed(rows, lambda row: percent(row["idss"], row["episodes"])),
            per_seed(rows, lambda row: percent(row["contact"], row["episodes"])),
            per_seed(rows, lambda row: cm(row["distance_m"]["mean"])),
            per_seed(rows, lambda row: cm(row["distance_m"]["p95"])),
            per_seed(rows, lambda row: "–" if (v := row["closing_m_s"]["median"]) is None else f"{v:.3f}"),
            per_seed(rows, lambda row: f"{row['smoothness']['mean']:.2f}"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.study.table", description=__doc__)
    parser.add_argument("results", nargs="+", type=Path, help="JSON that spacedock sweep wrote; several are joined")
    parser.add_argument("--tasks", nargs="+", default=[], help="ENV_ID/STARTS, these alone")
    parser.add_argument("--coefficients", nargs="+", type=float, default=[], help="of the ensemble, these alone")
    arguments = parser.parse_args(argv)
    try:
        print(table(read_trials(arguments.results), arguments.tasks, arguments.coefficients))
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
