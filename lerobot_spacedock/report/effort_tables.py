"""Beyond the paper: what an approach cost, and the smoothness of thrust and torque apart."""

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
    notes = ["Mean ± sample standard deviation. “–”: not tracked by the log's maker."]
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
        "Mean ± sample standard deviation. Eq. 4 adds N² and N·m² under one root, and grows with the step length; the "
        "columns to its right do neither.",
    )
    return Table("smoothness", "Smoothness, thrust and torque apart", head, tuple(rows), notes, 2)


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
