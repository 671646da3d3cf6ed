"""``python -m lerobot_spacedock.study.summarize``: episode logs in, one small JSON and one table out.

``--runs "ACT, seed 0"=outputs/eval/act-same/episodes ...``: what ``lerobot-eval`` left. Every episode counts; those
that only filled the last vector batch are left out and named. ``spacedock report`` says more about the same folders.
``--results results/act_cpu.json ...``: the table again from such JSON. Runs of the same name and starts, training seeds
(``NAME, seed N``, or a file each), share a line, a value a seed.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import InputError, SpaceDockError, reading
from lerobot_spacedock.files import write_text
from lerobot_spacedock.folders import check_output
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.report.runs import log_files
from lerobot_spacedock.study.results import cm, per_seed
from lerobot_spacedock.study.trial import summary

HEAD = ("run", "starts", "docked [95 %], of {}", "reached the plane", "distance mean, cm", "p95, cm", "p99, cm")
HEAD += ("‖v_K‖ mean, m/s", "smoothness")
_SEED = re.compile(r", seed \d+$")


def summarize_folder(name: str, folder: Path) -> list[dict[str, Any]]:
    """A row for each set of starts in a folder of episode logs.

    Raises:
        InputError: there is no episode, or one twice.
    """
    found, left_out = collect([log_files(folder)], workers=1)
    for exclusion in left_out:
        print(f"left out: {exclusion.path}: {exclusion.reason}", file=sys.stderr)
    rows = []
    for starts, episodes in found.items():
        every = [{key: values[i] for key, values in episodes.columns.items()} for i in range(len(episodes))]
        rows.append({"run": name, "starts": starts} | summary(every))
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown, a line for all rows of a name and its starts, with Clopper and Pearson's 95 % intervals."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[_SEED.sub("", row["run"]), row["starts"]].append(row)
    counts = sorted({row["episodes"] for row in rows})
    lines = ["| " + " | ".join(HEAD).format(" or ".join(map(str, counts))) + " |", "|" + "---|" * len(HEAD)]
    for (run, starts), seeds in groups.items():
        cells = [
            run,
            starts,
            per_seed(seeds, _docked),
            per_seed(seeds, lambda row: str(row["contact"])),
            *(per_seed(seeds, lambda row, name=name: cm(row["distance_m"][name])) for name in ("mean", "p95", "p99")),
            per_seed(seeds, lambda row: f"{row['speed_m_s']['mean']:.3f}"),
            per_seed(seeds, _spread),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _docked(row: dict[str, Any]) -> str:
    low, high = (100.0 * end for end in row["idss_interval"])
    return f"{row['idss']} [{low:.1f}, {high:.1f}]"


def _spread(row: dict[str, Any]) -> str:
    mean, std = row["smoothness"]["mean"], row["smoothness"]["std"]
    return "–" if mean is None else f"{mean:.2f}" if std is None else f"{mean:.2f} ± {std:.2f}"


def read_rows(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """The rows of result files, in order.

    Raises:
        InputError: a file that is not there.
        FileFormatError: a file that holds something else.
    """
    rows: list[dict[str, Any]] = []
    for path in paths:
        if not path.is_file():
            raise InputError("--results", str(path), "an existing file")
        with reading(path, "a result of lerobot_spacedock.study.summarize"):
            found = json.loads(path.read_text(encoding="utf-8"))
            if not found or not isinstance(found, list):
                raise ValueError("no list of rows")
            table(found)  # every number that it needs is there
        rows += found
    return rows


def write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    """Writes rows as JSON, one a line, aside and renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in rows)
    write_text(path, f"[\n{lines}\n]\n", shared=True)


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.study.summarize", description=__doc__)
    given = parser.add_mutually_exclusive_group(required=True)
    given.add_argument("--runs", nargs="+", default=[], help="NAME=FOLDER, one or more; a name may come twice")
    given.add_argument("--results", nargs="+", default=[], type=Path, help="JSON that this command wrote")
    parser.add_argument("--out", type=Path, help="write the rows as JSON here")
    arguments = parser.parse_args(argv)
    try:
        if arguments.out:
            check_output(arguments.out, "--out")
        rows = read_rows(arguments.results)
        seen: set[Path] = set()
        for run in arguments.runs:
            name, _, folder = run.partition("=")
            if not (name and folder):
                raise InputError("--runs", run, "NAME=FOLDER")
            place = Path(folder).resolve()
            if place in seen:  # it would pass for another training seed
                raise InputError("--runs", f"{folder} twice", "each folder once")
            seen.add(place)
            rows += summarize_folder(name, Path(folder))
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(table(rows))
    if arguments.out:
        write_rows(arguments.out, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
