"""Beyond the paper: intervals, every pair of runs compared, paired tests on matched starts, spread over seeds."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from lerobot_spacedock.metrics.catalog import BY_NAME
from lerobot_spacedock.metrics.collect import EpisodeSet
from lerobot_spacedock.metrics.paired import holm, match_starts, mcnemar, pair_means, spread_over_seeds, wilcoxon
from lerobot_spacedock.metrics.statistics import (
    Test,
    bootstrap,
    cliffs_delta,
    hedges_g,
    levene,
    mann_whitney,
    shapiro_wilk,
    welch,
)
from lerobot_spacedock.report.model import Run, Study
from lerobot_spacedock.report.table import DASH, Cell, Table, integer, interval, number, p_value, percent

COMPARED = ("final_distance_m", "final_speed_m_s", "smoothness", "delta_v_m_s")
STATISTICS = {
    "mean": np.mean,
    "median": np.median,
    "75 %": lambda block, axis: np.percentile(block, 75, axis=axis),
    "95 %": lambda block, axis: np.percentile(block, 95, axis=axis),
    "99 %": lambda block, axis: np.percentile(block, 99, axis=axis),
}


def intervals_table(study: Study, resamples: int) -> Table:
    """Bootstrap intervals of means and percentiles."""
    head = ("set", "run", "metric", "n", *STATISTICS)
    rows, remarks = [], set()
    for conditions, run, e in study.groups():
        for name in COMPARED:
            values = e.values(name)
            cells = []
            for statistic in STATISTICS.values():
                b = bootstrap(values, statistic, resamples=resamples)
                remarks |= {f"{run.label}, {conditions}, {_named(name)}: {b.note}." for _ in [0] if b.note}
                cells.append(interval(b.estimate, b.low, b.high))
            rows.append((conditions, run.label, _named(name), integer(len(values)), *cells))
    notes = (
        f"Brackets: 95 % percentile bootstrap intervals, {resamples:,} resamples of episodes, fixed seed. High "
        "percentiles of few episodes hang on the worst one or two: their intervals end there.",
        *study.pooled(),
        *sorted(remarks),
    )
    return Table("intervals", "Bootstrap intervals", head, tuple(rows), notes, 3)


def pairs_table(study: Study) -> Table:
    """Every pair of runs on every compared metric: tests, effect sizes, Holm's adjustment."""
    head = (
        "set", "metric", "pair", "Shapiro p", "Levene p", "Welch t (df)", "Welch p", "Mann–Whitney U", "p", "p, Holm",
        "Hedges g [95 %]", "Cliff's δ",
    )  # fmt: skip
    drafts, raw, remarks = [], [], set()
    for conditions in study.conditions():
        for (run_a, a), (run_b, b) in combinations(study.flown(conditions), 2):
            for name in COMPARED:
                x, y = a.values(name), b.values(name)
                pair = f"{run_a.label} − {run_b.label}"
                t, u, spread = welch(x, y), mann_whitney(x, y), levene(x, y)
                g, delta = hedges_g(x, y), cliffs_delta(x, y)
                normal = " / ".join(p_value(shapiro_wilk(v).p).text for v in (x, y))
                text = DASH if t.statistic is None else f"{number(t.statistic, 2).text} ({t.df:.1f})"
                remarks |= {f"{pair}, {_named(name)}: {r.note}." for r in (t, u, spread, g) if r.note}
                raw.append(u.p)
                row = [conditions, _named(name), pair, normal, p_value(spread.p)]
                row += [Cell(text, {"t": t.statistic, "df": t.df}), p_value(t.p), number(u.statistic, 0), p_value(u.p)]
                drafts.append((row, [interval(g.estimate, g.low, g.high, 2), number(delta.estimate, 2)]))
    rows = tuple(
        (*row, p_value(adjusted), *effects) for (row, effects), adjusted in zip(drafts, holm(raw), strict=True)
    )
    notes = (
        "Negative effect: the first run's values are smaller. Holm: "
        "over all Mann–Whitney tests of this table. Where Shapiro p is small, lean on Mann–Whitney and Cliff's δ.",
        *study.mixed(),
        *study.pooled(),
        *sorted(remarks),
    )
    return Table("pairs", "Runs compared", head, rows, notes if rows else ("One run: nothing to compare.",), 3)


def matched_table(study: Study) -> Table:
    """Paired tests, where two runs flew the same starts for the same task."""
    head = ("set", "pair", "pairs", "metric", "median difference", "test", "statistic", "p", "p, Holm")
    drafts: list[tuple[list[Cell | str], float | None]] = []
    notes, remarks = [], []
    for conditions in study.conditions():
        for (run_a, a), (run_b, b) in combinations(study.flown(conditions), 2):
            pair = f"{run_a.label} − {run_b.label}"
            in_a, in_b = match_starts(a.starts, b.starts)
            shared = np.intersect1d(in_a[in_a >= 0], in_b[in_b >= 0])
            reason = _unmatched(run_a, in_a, run_b, in_b, shared)
            if reason:
                notes.append(f"{pair}, {conditions}: no paired test. {reason}")
                continue
            for name in (*COMPARED, "idss"):
                row, test = _paired_row(conditions, pair, name, a, in_a, b, in_b, shared)
                drafts.append((row, test.p))
                if test.note and not test.name.startswith("McNemar"):  # whose note stands in the row
                    remarks.append(f"{pair}, {conditions}, {_named(name)}: {test.note}.")
    adjusted = holm([p for _, p in drafts])
    rows = tuple((*row, p_value(p), p_value(q)) for (row, p), q in zip(drafts, adjusted, strict=True))
    notes.append("Where several episodes of a run began in one state (training seeds), a pair takes their mean.")
    if rows:
        notes.append("Holm: over all tests of this table.")
    notes += remarks
    return Table("matched", "Paired tests on matched starts", head, rows, tuple(notes), 2)


def seeds_table(study: Study) -> Table | None:
    """Spread over training seeds, for runs of several; ``None`` where there is none."""
    head = ("set", "run", "training seeds", *map(_named, COMPARED), f"{_named('idss')}, each seed")
    rows = []
    for conditions, run, e in study.groups():
        if e.training_seeds < 2:
            continue
        seeds = np.unique(e.folder)
        cells = []
        for name in COMPARED:
            means = [_mean(own) for own in _by_seed(e, name, seeds)]
            s = spread_over_seeds([m for m in means if m is not None])
            cells.append(interval(s.estimate, s.low, s.high))
        docked = [(int(np.nansum(own)), int(np.sum(~np.isnan(own)))) for own in _by_seed(e, "idss", seeds)]
        shares = Cell(" / ".join(f"{percent(*count)} %" for count in docked if count[1]), [k for k, _ in docked])
        rows.append((conditions, run.label, integer(len(seeds)), *cells, shares))
    if not rows:
        return None
    notes = (
        "Mean over training seeds of each seed's mean, with Student's 95 % interval over seeds; shares one by one.",
    )
    return Table("seeds", "Spread over training seeds", head, tuple(rows), notes, 2)


def _unmatched(run_a: Run, in_a: np.ndarray, run_b: Run, in_b: np.ndarray, shared: np.ndarray) -> str:
    if not run_a.task.agrees(run_b.task):
        return f"The runs flew different tasks: {run_a.task}; {run_b.task}."
    left_a, left_b = int(np.sum(in_a < 0)), int(np.sum(in_b < 0))
    if len(shared) == 0:
        return "The runs share no start."
    if left_a and left_b:
        return (
            f"{left_a} of {len(in_a)} episodes of {run_a.label} and {left_b} of {len(in_b)} of {run_b.label} have no "
            "partner: the starts do not match."
        )
    return ""


def _paired_row(
    conditions: str,
    pair: str,
    name: str,
    a: EpisodeSet,
    in_a: np.ndarray,
    b: EpisodeSet,
    in_b: np.ndarray,
    shared: np.ndarray,
) -> tuple[list[Cell | str], Test]:
    x, y = pair_means(a.columns[name], in_a, shared), pair_means(b.columns[name], in_b, shared)
    both = ~(np.isnan(x) | np.isnan(y))
    x, y = x[both], y[both]
    binary = name == "idss" and np.isin(np.concatenate([x, y]), (0.0, 1.0)).all()
    test = mcnemar(x > 0.5, y > 0.5) if binary else wilcoxon(x, y)
    difference = number(float(np.median(x - y))) if len(x) and not binary else Cell(test.note if binary else DASH, None)
    row: list[Cell | str] = [conditions, pair, integer(len(x)), _named(name), difference, test.name]
    return [*row, number(test.statistic, 1)], test


def _by_seed(episodes: EpisodeSet, name: str, seeds: np.ndarray) -> list[np.ndarray]:
    return [episodes.columns[name][episodes.folder == seed] for seed in seeds]


def _mean(values: np.ndarray) -> float | None:
    values = values[~np.isnan(values)]
    return float(values.mean()) if len(values) else None


def _named(name: str) -> str:
    metric = BY_NAME[name]
    return f"{metric.label} ({metric.unit})" if metric.unit else metric.label
