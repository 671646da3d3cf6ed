"""Tables 1–4 of the paper, over the runs given, with the paper's rows beside ours."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from lerobot_spacedock.metrics.statistics import levene, shapiro_wilk, summarize, welch, welch_from_summary
from lerobot_spacedock.report import paper
from lerobot_spacedock.report.model import Study
from lerobot_spacedock.report.table import Cell, Table, integer, number, p_value


def table1(study: Study) -> Table:
    """Sample efficiency: the expert's training and the demonstrations, both counted."""
    head = (
        "method",
        "training episodes",
        "training interactions",
        "demonstrations",
        "demonstration interactions",
        "all interactions",
    )
    rows, notes = [], []
    for run in study.runs:
        if run.samples is None:
            rows.append((run.label, *(Cell("not stated", None),) * 5))
            continue
        s = run.samples
        parts = [n for n in (s.training_interactions, s.demonstration_interactions) if n is not None]
        counts = (s.training_episodes, s.training_interactions, s.demonstrations, s.demonstration_interactions)
        whole = s.training_interactions is not None  # without the training there is no bill to add up
        rows.append((run.label, *(_stated(n) for n in counts), _stated(sum(parts) if whole else None)))
        if s.flown_episodes is not None and s.demonstrations is not None:
            notes.append(f"{run.label}: {s.demonstrations:,} demonstrations kept of {s.flown_episodes:,} flown.")
        if s.expert is not None:
            notes.append(f"{run.label} imitates {s.expert}, whose training is on its bill.")
    first_paper = len(rows)
    for p in paper.SAMPLES:
        parts = [n for n in (p.training_interactions, p.demonstration_interactions) if n is not None]
        counts = (p.training_episodes, p.training_interactions, p.demonstrations, p.demonstration_interactions)
        rows.append((p.method, *(integer(n) for n in counts), integer(sum(parts))))
    notes.append(
        "An imitator's bill holds the training of the expert that flew its demonstrations. Counts come from the "
        "policy.json that an evaluation leaves beside its logs, or from --training label=file.json and --demos "
        "label=dataset. “Not stated”: neither says."
    )
    return Table(
        "table1", "Table 1. Sample efficiency", head, tuple(rows), tuple(notes), 1, _from(first_paper, len(rows))
    )


def table2(study: Study) -> Table:
    """Initial conditions: as specified, and as flown (least and most of each component)."""
    head = ("set", "run", "episodes", "x, z (m)", "y (m)", "velocity (m/s)", "attitude off nominal", "rates (°/s)")
    rows: list[tuple[Cell | str, ...]] = []
    reference = []
    for conditions in study.conditions():
        if conditions in paper.STARTS:
            position, velocity, attitude, rates = paper.STARTS[conditions]
            across, _, along = position.partition(", y ∈ ")
            reference.append(len(rows))
            rows.append(
                (
                    conditions,
                    "specified",
                    "",
                    across.replace("x, z ∈ ", ""),
                    along or position,
                    velocity,
                    attitude,
                    rates,
                )
            )
        for run, episodes in study.flown(conditions):
            s = episodes.starts
            off = episodes.values("start_misalignment_deg")
            rows.append(
                (
                    conditions,
                    run.label,
                    integer(len(episodes)),
                    _range(s[:, [0, 2]]),
                    _range(s[:, 1]),
                    _range(s[:, 3:6], 3),
                    Cell(f"up to {off.max():.2f}°", float(off.max())),
                    _range(s[:, 10:13], 3),
                )
            )
    notes = (
        paper.STARTS_NOTE,
        "As flown: least and most over all episodes and components.",
    )
    return Table("table2", "Table 2. Starts", head, tuple(rows), notes, 2, frozenset(reference))


def table3(study: Study) -> Table:
    """‖r_K‖ and ‖v_K‖ at the last state: mean, 75, 95, 99 %."""
    quantities = (("‖r_K‖", "m"), ("‖v_K‖", "m/s"))
    head = (
        "set",
        "method",
        "n",
        *(f"{name} {part} ({unit})" for name, unit in quantities for part in ("mean", "75 %", "95 %", "99 %")),
    )
    rows: list[tuple[Cell | str, ...]] = []
    reference: list[int] = []
    for conditions in study.conditions():
        for run, episodes in study.flown(conditions):
            cells: list[Cell] = []
            for name in ("final_distance_m", "final_speed_m_s"):
                s = summarize(episodes.values(name), f"{run.label} {name}")
                cells += [number(value) for value in (s.mean, s.p75, s.p95, s.p99)]
            rows.append((conditions, run.label, integer(len(episodes)), *cells))
        if conditions == "same":
            reference += range(len(rows), len(rows) + len(paper.ACCURACY))
            for p in paper.ACCURACY:
                values = (number(v) for v in (*p.distance_m, *p.speed_m_s))
                rows.append((conditions, p.method, integer(100), *values))
    notes = (
        "Every episode counts, whatever its outcome. Percentiles by linear interpolation.",
        *study.beside_the_paper(),
    )
    return Table("table3", "Table 3. Final distance and speed", head, tuple(rows), notes, 2, frozenset(reference))


def table4(study: Study) -> Table:
    """Smoothness (Eq. 4), with the tests of its assumptions, and Welch's test of each pair."""
    head = ("set", "method, or pair", "n", "mean ± std", "Shapiro p", "Levene p", "Welch t", "df", "p")
    rows: list[tuple[Cell | str, ...]] = []
    reference: list[int] = []
    remarks: set[str] = set()
    for conditions in study.conditions():
        flown = [(run.label, episodes.values("smoothness")) for run, episodes in study.flown(conditions)]
        for label, values in flown:
            s, normal = summarize(values, label), shapiro_wilk(values)
            remarks.update(f"{label}, {conditions}: Shapiro–Wilk: {normal.note}." for _ in [0] if normal.note)
            row = (conditions, label, integer(s.n), _mean_std(s.mean, s.std), p_value(normal.p))
            rows.append((*row, "", "", "", ""))
        for (label_a, a), (label_b, b) in combinations(flown, 2):
            t, spread = welch(a, b), levene(a, b)
            remarks.update(f"{label_a} − {label_b}, {conditions}: {test.note}." for test in (t, spread) if test.note)
            pair = (conditions, f"{label_a} − {label_b}", "", "", "", p_value(spread.p))
            rows.append((*pair, number(t.statistic, 2), number(t.df, 1), p_value(t.p)))
    first_paper = len(rows)
    for p in paper.SMOOTHNESS:
        row = (p.conditions, p.method, integer(p.n), _mean_std(p.mean, p.std), p_value(p.shapiro_p))
        rows.append((*row, "", "", "", ""))
    act, rl = paper.SMOOTHNESS[0], paper.SMOOTHNESS[-1]
    t = welch_from_summary(act.mean, act.std, act.n, rl.mean, rl.std, rl.n)
    cells = (number(t.statistic, 2), number(t.df, 1), p_value(t.p))
    rows.append(("mixed", "ACT − RL, from the paper's figures", "", "", "", "", *cells))
    reference += range(first_paper, len(rows))
    notes = (
        "Mean over an episode's steps of ‖a_{k+1} − a_k‖, a in N and N·m together as in the paper's Eq. 4; std is "
        "the sample's (n − 1).",
        "The last row recomputes Welch's test from the printed means and spreads; the paper states "
        f"df = {paper.WELCH_DF}.",
        *study.beside_the_paper(),
        *study.mixed(),
        *study.pooled(),
        *sorted(remarks),
    )
    return Table("table4", "Table 4. Smoothness of the commands", head, tuple(rows), notes, 2, frozenset(reference))


def _mean_std(mean: float | None, std: float | None) -> Cell:
    if mean is None:
        return number(None)
    spread = f" ± {std:.3f}" if std is not None else ""
    return Cell(f"{mean:.3f}{spread}", {"mean": mean, "std": std})


def _range(values: np.ndarray, digits: int = 2) -> Cell:
    low, high = float(values.min()), float(values.max())
    return Cell(f"[{number(low, digits).text}, {number(high, digits).text}]", [low, high])


def _stated(count: int | None) -> Cell:
    return Cell("not stated", None) if count is None else integer(count)


def _from(first: int, end: int) -> frozenset[int]:
    return frozenset(range(first, end))
