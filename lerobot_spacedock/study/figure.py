"""``spacedock sweep-figure``: accuracy against smoothness over coefficient, chunk and kind of demonstration."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.report.figures.style import INK, Figure, Panel, run_style, write_paper_files
from lerobot_spacedock.report.paper import ACCURACY, SMOOTHNESS


@dataclass
class FigureConfig:
    """Draws a sweep: one panel a kind of demonstration, one curve a chunk size, one point a coefficient."""

    # JSON that spacedock sweep wrote; several are joined
    results: list[str] = field(default_factory=list)
    # folder of the PNG and the SVG
    out: str = "docs/images"
    # name of the files
    key: str = "sweep_frontier"
    # the task whose distance and smoothness are drawn
    task: str = "SpaceDock-v0/same"
    # kinds of demonstrations, a panel each; by default all that are there
    demonstrations: list[str] = field(default_factory=list)
    # coefficients; by default all that are there
    coefficients: list[float] = field(default_factory=list)


def sweep_figure(config: FigureConfig) -> int:
    """Runs the verb; see the module."""
    trials = read_trials([Path(path) for path in config.results])
    curves = frontier(trials, config.task)
    kinds = config.demonstrations or sorted({kind for kind, _ in curves})
    chunks = sorted({chunk for _, chunk in curves})
    missing = [kind for kind in kinds if not any(kind == known for known, _ in curves)]
    if missing or not curves:
        raise InputError("--demonstrations", missing, " ".join(sorted({kind for kind, _ in curves})) or "none")
    panels = tuple(
        Panel(kind.replace("_", " "), lambda axes, kind=kind: _draw(axes, kind, chunks, curves, config.coefficients))
        for kind in kinds
    )
    title = f"Distance against smoothness, {config.task}"
    for path in write_paper_files(Figure(config.key, title, title, panels, columns=len(panels)), Path(config.out)):
        print(f"Wrote {path}")
    return 0


def read_trials(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """The trials of result files, in order.

    Raises:
        InputError: no file was named, or one is not there.
        FileFormatError: one is no result of a sweep.
    """
    if not paths:
        raise InputError("--results", "nothing", "one JSON file or more, as spacedock sweep writes them")
    trials = []
    for path in paths:
        if not path.is_file():
            raise InputError("--results", str(path), "an existing file")
        try:
            trials += json.loads(path.read_text(encoding="utf-8"))["trials"]
        except (ValueError, KeyError, TypeError) as error:
            raise FileFormatError(f"{path}: not a result of spacedock sweep ({error!r}).") from error
    return trials


def frontier(
    trials: list[dict[str, Any]], task: str
) -> dict[tuple[str, int], dict[float | None, tuple[np.ndarray, np.ndarray]]]:
    """Smoothness and mean distance of every training seed, by (kind, chunk) and coefficient: each (S,), (S,) m."""
    found: dict = defaultdict(lambda: defaultdict(list))
    for trial in trials:
        point = trial["point"]
        for row in trial["rows"]:
            if row["task"] == task:
                numbers = (row["smoothness"]["mean"], row["distance_m"]["mean"])
                found[point["demonstrations"], point["chunk_size"]][row["coefficient"]].append(numbers)
    return {
        key: {coefficient: tuple(np.array(seeds).T) for coefficient, seeds in rows.items()}
        for key, rows in found.items()
    }


def _draw(axes: Any, kind: str, chunks: list[int], curves: dict, wanted: list[float]) -> None:
    for place, chunk in enumerate(chunks):
        rows = curves.get((kind, chunk))
        if rows is None:
            continue
        # from old predictions to new: along the curve the weight moves to the newest chunk
        order = sorted(
            (c for c in rows if not wanted or c is None or c in wanted), key=lambda c: -np.inf if c is None else c
        )
        x = [float(rows[c][0].mean()) for c in order]
        y = [float(rows[c][1].mean()) for c in order]
        style = run_style(place)
        axes.plot(x, y, label=f"chunk {chunk}", markersize=4, linewidth=1.2, **style)
        for c in order:
            axes.plot(*rows[c], ".", color=style["color"], alpha=0.35, markersize=3)
            if c == 0.01:  # LeRobot's and the authors' own
                axes.plot(float(rows[c][0].mean()), float(rows[c][1].mean()), "o", ms=9, mfc="none", mec=style["color"])
    rollouts = (SMOOTHNESS[1].mean, ACCURACY[1].distance_m[0])
    axes.plot(*rollouts, "*", color=INK, markersize=11, label="paper's ACT (rollouts)", linestyle="none")
    axes.set_yscale("log")
    axes.set_xlabel("smoothness, mean ‖Δa‖ (Eq. 4; less is smoother)")
    axes.set_ylabel("mean ‖r_K‖ (m)")
    axes.legend(loc="best", fontsize=7.5)
