"""``spacedock sweep-figure``: accuracy against smoothness over coefficient, chunk and kind of demonstration."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.contact import IDSS
from lerobot_spacedock.report.figures.style import (
    INK,
    LIMIT,
    MUTED,
    Figure,
    Panel,
    plain_log,
    run_style,
    write_paper_files,
)
from lerobot_spacedock.report.paper import ACCURACY, SMOOTHNESS, RANDOM_DISTANCE_m
from lerobot_spacedock.study.results import read_trials
from lerobot_spacedock.study.table import group

# smoothness and mean distance of the paper's ACT, by its rollouts
PAPERS_ACT = {
    "SpaceDock-v0/same": (SMOOTHNESS[1].mean, ACCURACY[1].distance_m[0]),
    "SpaceDock-v0/random": (SMOOTHNESS[0].mean, RANDOM_DISTANCE_m),
}
FIXED_HORIZON = "SpaceDock-v0/"
DRAWN = ("demonstrations", "chunk_size")  # a panel each, a curve each
LEROBOTS = 0.01  # LeRobot's and the authors' coefficient


@dataclass
class FigureConfig:
    """Draws a sweep: a row a task, a panel a kind of demonstration, a curve a chunk size, a point a coefficient."""

    # JSON that spacedock sweep wrote; several are joined
    results: list[str] = field(default_factory=list)
    # folder of the PNG and the SVG; made if absent
    out: str = "outputs/figures"
    # name of the files; by default that of the results
    key: str | None = None
    # the tasks whose distance at the end and smoothness are drawn; by default all that were flown
    tasks: list[str] = field(default_factory=list)
    # kinds of demonstrations, a panel each; by default all that are there
    demonstrations: list[str] = field(default_factory=list)


def sweep_figure(config: FigureConfig) -> int:
    """Runs the verb; see the module."""
    trials = read_trials([Path(path) for path in config.results])
    if not trials:
        raise InputError("--results", " ".join(config.results), "results with a finished trial")
    if others := not_drawn(trials):
        given = f"trials that differ in {', '.join(others)} too"
        mend = "Its points would be means over those: python -m lerobot_spacedock.study.table shows them apart."
        raise InputError("--results", given, f"trials that differ in {', '.join(DRAWN)} and seed alone", mend)
    flown = sorted({row["task"] for trial in trials for row in trial["rows"]})
    tasks = config.tasks or flown
    for task in tasks:
        if task not in flown:
            raise InputError("--tasks", task, " ".join(flown))
    by_task = {task: frontier(trials, task) for task in tasks}
    known = sorted({kind for curves in by_task.values() for kind, _ in curves})
    kinds = config.demonstrations or known
    chunks = sorted({chunk for curves in by_task.values() for _, chunk in curves})
    missing = [kind for kind in kinds if kind not in known]
    if missing:
        raise InputError("--demonstrations", missing, " ".join(known))
    panels = tuple(
        Panel(f"{kind.replace('_', ' ')}, {task}", partial(_draw, task=task, kind=kind, chunks=chunks, by_task=by_task))
        for task in tasks
        for kind in kinds
    )
    title, out = "Distance at the end against smoothness", Path(config.out)
    key = config.key or "_".join(Path(path).stem for path in config.results)
    out.mkdir(parents=True, exist_ok=True)
    for path in write_paper_files(Figure(key, title, title, panels, columns=len(kinds)), out):
        print(f"Wrote {path}")
    print(f"Next: python -m lerobot_spacedock.study.table {' '.join(config.results)}")
    return 0


def not_drawn(trials: list[dict[str, Any]]) -> list[str]:
    """The axes that trials differ in and that a figure does not show; it can be drawn where there is none."""
    vary, _ = group(trials)
    return [name for name in vary if name not in DRAWN]


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


def _draw(axes: Any, *, task: str, kind: str, chunks: list[int], by_task: dict[str, dict]) -> None:
    ring = {"marker": "o", "markersize": 10, "markerfacecolor": "none", "linestyle": "none"}
    ringed = False
    for place, chunk in enumerate(chunks):
        rows = by_task[task].get((kind, chunk))
        if rows is None:
            continue
        # from new predictions to old along the curve: None is the newest chunk alone
        order = sorted(rows, key=lambda coefficient: -np.inf if coefficient is None else coefficient)
        means = np.array([[values.mean() for values in rows[coefficient]] for coefficient in order])
        style = run_style(place)
        axes.plot(*means.T, label=f"chunk {chunk}", markersize=4, linewidth=1.2, **style)
        for coefficient, mean in zip(order, means, strict=True):
            axes.plot(*rows[coefficient], ".", color=style["color"], alpha=0.35, markersize=3)
            if coefficient == LEROBOTS:
                axes.plot(*mean, markeredgecolor=style["color"], **ring)
                ringed = True
    if ringed:
        axes.plot([], [], label=f"coefficient {LEROBOTS:g}", markeredgecolor=MUTED, **ring)
    if task in PAPERS_ACT:
        axes.plot(*PAPERS_ACT[task], "*", color=INK, markersize=11, label="paper's ACT", linestyle="none")
    axes.set_xscale("log")
    axes.set_yscale("log")
    _same_limits(axes, task, by_task)
    low, high = axes.get_ylim()
    if not task.startswith(FIXED_HORIZON) and low < IDSS.lateral_m < high:
        axes.axhline(IDSS.lateral_m, color=LIMIT, linewidth=0.9, linestyle="--", label="IDSS lateral limit")
    axes.set_xlabel("mean ‖Δa‖, Eq. 4 (less is smoother)")
    axes.set_ylabel("mean ‖r_K‖ (m)" if task.startswith(FIXED_HORIZON) else "mean distance at the end (m)")
    axes.legend(loc="best", fontsize=7.5)


def _same_limits(axes: Any, task: str, by_task: dict[str, dict]) -> None:
    """Every panel of a row has the same axes, with numbers as people write them."""
    points = [np.array(PAPERS_ACT[task])[:, None]] if task in PAPERS_ACT else []
    points += [np.array(numbers) for rows in by_task[task].values() for numbers in rows.values()]
    together = np.concatenate(points, axis=1)
    for low, high, set_limits, axis in zip(
        together.min(axis=1),
        together.max(axis=1),
        (axes.set_xlim, axes.set_ylim),
        (axes.xaxis, axes.yaxis),
        strict=True,
    ):
        plain_log(axis, *set_limits(low / 1.25, high * 1.25))
