"""``python -m lerobot_spacedock.study.summarize``: episode logs in, one small JSON and one table out.

``--runs SEED0=outputs/eval/act-same/episodes ...``: what ``lerobot-eval`` left. Every episode counts; those that only
filled the last vector batch are left out and named. ``spacedock report`` says more about the same folders.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.report.runs import log_files
from lerobot_spacedock.study.trial import summary

HEAD = (
    "| run | starts | IDSS box | contact | ‖r_K‖ mean / p95 / p99 (cm) | ‖v_K‖ mean (m/s) | smoothness |\n"
    "|---|---|---|---|---|---|---|"
)


def summarize_folder(name: str, folder: Path) -> list[dict[str, Any]]:
    """A row for each set of starts in a folder of episode logs.

    Raises:
        InputError: there is no episode.
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
    """Markdown, a line a row, with Clopper and Pearson's 95 % interval."""
    lines = [HEAD]
    for row in rows:
        low, high = (100.0 * end for end in row["idss_interval"])
        distance, smoothness = row["distance_m"], row["smoothness"]
        lines.append(
            f"| {row['run']} | {row['starts']} | {row['idss']} of {row['episodes']} [{low:.1f}, {high:.1f}] % "
            f"| {row['contact']} | {100 * distance['mean']:.1f} / {100 * distance['p95']:.1f} / "
            f"{100 * distance['p99']:.1f} | {row['speed_m_s']['mean']:.3f} "
            f"| {smoothness['mean']:.2f} ± {smoothness['std']:.2f} |"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.study.summarize", description=__doc__)
    parser.add_argument("--runs", nargs="+", required=True, help="NAME=FOLDER, one or more; a name may come twice")
    parser.add_argument("--out", type=Path, help="write the rows as JSON here")
    arguments = parser.parse_args(argv)
    try:
        rows = []
        for run in arguments.runs:
            name, _, folder = run.partition("=")
            if not (name and folder):
                raise InputError("--runs", run, "NAME=FOLDER")
            rows += summarize_folder(name, Path(folder))
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(table(rows))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in rows)
        arguments.out.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
