"""Beyond the paper: what an approach cost, the smoothness of thrust and torque apart, and time to think."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.metrics.catalog import BY_NAME
from lerobot_spacedock.metrics.collect import EpisodeSet
from lerobot_spacedock.metrics.statistics import summarize
from lerobot_spacedock.report.model import Study
from lerobot_spacedock.report.table import DASH, Cell, Table, integer, number

APART = (
    "smoothness",
    "smoothness_thrust_N",
    "smoothness_torque_Nm",
    "smoothness_per_limit",
    "smoothness_thrust_N_s",
    "smoothness_torque_Nm_s",
    "smoothness_per_limit_s",
)
COST = ("delta_v_m_s", "propellant_kg", "impulse_N_s", "angular_impulse_N_m_s", "peak_thrust_N", "peak_torque_Nm")


def effort_table(study: Study) -> Table:
    """Δv, propellant and impulse, and the ratio to the reference controller's mean."""
    against = f"Δv / {study.reference}'s" if study.reference else "Δv ratio"
    head = ("set", "run", "n", *map(_head, COST), against, "steps at a limit", "steps clipped")
    rows = []
    for conditions in study.conditions():
        flown = list(study.flown(conditions))
        base = next((_mean(e, "delta_v_m_s") for run, e in flown if run.label == study.reference), None)
        for run, e in flown:
            own = _mean(e, "delta_v_m_s")
            ratio = own / base if base and own is not None else None
            cells = (_spread(e, name) for name in COST)
            saturated = _mean(e, "saturated_share")
            steps = e.columns["steps"][~np.isnan(e.columns["clipped_actions"])].sum()
            clipped = float(e.values("clipped_actions").sum() / steps) if steps else None
            shares = (_percent(saturated), _percent(clipped))
            rows.append((conditions, run.label, integer(len(e)), *cells, number(ratio, 2), *shares))
    notes = [
        "Mean ± sample standard deviation. “–”: not tracked by the log's maker. Δv, impulses and peaks are of the "
        "commands; propellant is of what was executed.",
    ]
    notes += study.mixed()
    if study.reference is None:
        notes.append("No run is named as reference (--reference): no ratio.")
    return Table("effort", "Effort", head, tuple(rows), tuple(notes), 2)


def smoothness_table(study: Study) -> Table:
    """Thrust and torque apart, per limit, and per second."""
    head = ("set", "run", "n", *map(_head, APART))
    rows = [
        (conditions, run.label, integer(len(e)), *(_spread(e, name) for name in APART))
        for conditions, run, e in study.groups()
    ]
    notes = (
        "Mean ± sample standard deviation. Eq. 4 adds N² and (N·m)² under one root, and, as every change from step to "
        "step, grows with the step length; the columns per second do not.",
    )
    return Table("smoothness", "Smoothness, thrust and torque apart", head, tuple(rows), notes, 2)


def inference_table(study: Study) -> Table:
    """How long a policy thinks, a step, and whether that would do on board."""
    head = (
        "set",
        "run",
        "episodes at once",
        "episodes timed",
        "mean (ms)",
        "mean, 95 % of episodes (ms)",
        "longest step (ms)",
        "share of a control step",
    )
    rows: list[tuple[Cell | str, ...]] = []
    for conditions, run, e in study.groups():
        batches, mean, longest = (e.values(name) for name in ("inference_batch", "inference_ms", "inference_max_ms"))
        if not len(mean):
            rows.append((conditions, run.label, *(Cell("not stated", None),) * 6))
            continue
        at_once = sorted({int(batch) for batch in batches})
        size = Cell(", ".join(map(str, at_once)) or "not stated", at_once)
        step_ms = 1e3 * e.columns["duration_s"].sum() / max(e.columns["steps"].sum(), 1.0)
        share_of_step = float(longest.max() / step_ms) if step_ms else None
        cells = (number(float(mean.mean())), number(summarize(mean).p95), number(float(longest.max())))
        share_cell = Cell(DASH if share_of_step is None else f"{100 * share_of_step:.1f} %", share_of_step)
        rows.append((conditions, run.label, size, integer(len(mean)), *cells, share_cell))
    notes = (
        "Wall time between the simulator’s answer and the next command: the policy with its pre- and post-processing, "
        "once for all episodes that were flown at once (not divided by them), on the machine that flew the run. The "
        "first call of an evaluation, which also compiles and allocates, is left out. Share: the longest step against "
        "the mean length of a control step. A policy that commands chunks thinks at their beginnings only: read the "
        "longest step. “Not stated”: logs by other makers, or of before this was measured.",
    )
    return Table("inference", "Inference time a step", head, tuple(rows), notes, 2)


def _head(name: str) -> str:
    metric = BY_NAME[name]
    return f"{metric.label} ({metric.unit})" if metric.unit else metric.label


def _mean(episodes: EpisodeSet, name: str) -> float | None:
    values = episodes.values(name)
    return float(values.mean()) if len(values) else None


def _spread(episodes: EpisodeSet, name: str) -> Cell:
    s = summarize(episodes.values(name))
    if s.mean is None:
        return Cell(DASH, None)
    spread = f" ± {number(s.std).text}" if s.std is not None else ""
    return Cell(number(s.mean).text + spread, {"mean": s.mean, "std": s.std, "n": s.n})


def _percent(value: float | None) -> Cell:
    return Cell(DASH, None) if value is None else Cell(f"{100 * value:.1f} %", value)
