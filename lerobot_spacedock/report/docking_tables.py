"""Beyond the paper: tolerance ladder, the docking boxes one condition at a time, state at contact, corridor."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.metrics.catalog import BY_NAME, LADDER_M
from lerobot_spacedock.metrics.collect import EpisodeSet
from lerobot_spacedock.metrics.episode import ATV_CONDITIONS, CONTACT_NUMBERS, IDSS_CONDITIONS
from lerobot_spacedock.metrics.statistics import clopper_pearson, summarize
from lerobot_spacedock.physics.contact import ATV, IDSS, ContactBox
from lerobot_spacedock.report import paper
from lerobot_spacedock.report.model import Study
from lerobot_spacedock.report.table import Cell, Table, integer, number, share

INTERVALS = "Brackets: 95 % Clopper–Pearson intervals."


def at_a_glance(study: Study) -> Table:
    """The few numbers that a reader asks for first."""
    head = (
        "set",
        "run",
        "task",
        "episodes",
        "IDSS box",
        "median ‖r_K‖ (m)",
        "median miss at contact (m), of",
        "‖Δa‖",
        "Δv (m/s)",
    )
    rows = []
    for conditions, run, e in study.groups():
        miss = e.values("lateral_m")
        distance, smoothness, delta_v = (
            number(summarize(e.values(name)).median) for name in ("final_distance_m", "smoothness", "delta_v_m_s")
        )
        at_contact = number(summarize(miss).median)
        at_contact = Cell(f"{at_contact.text}, {len(miss)}", at_contact.value)
        shares = integer(len(e)), flag_share(e, "idss")
        rows.append((conditions, run.label, str(run.task), *shares, distance, at_contact, smoothness, delta_v))
    notes = (
        "IDSS box: all initial contact conditions of the International Docking System Standard, at the state that the "
        "log names as contact, else at the crossing of the port plane. Where the task is to touch the port, a flight "
        "that never reached its plane is outside the box and has no miss: the count beside the median says of how many "
        "it is. In the fixed-horizon task the state is the last one, and the box limits the whole distance. "
        + INTERVALS,
        *study.mixed(),
        *study.pooled(),
    )
    return Table("glance", "Headline numbers", head, tuple(rows), notes, 3)


def ladder(study: Study) -> Table:
    """Shares of episodes that end within each tolerance."""
    head = ("set", "run", "n", *(f"‖r_K‖ ≤ {tolerance:g} m" for tolerance in LADDER_M), "best (m)")
    rows: list[tuple[Cell | str, ...]] = []
    reference = []
    for conditions in study.conditions():
        for run, e in study.flown(conditions):
            distance = e.values("final_distance_m")
            cells = [_share(int(np.sum(distance <= tolerance)), len(distance)) for tolerance in LADDER_M]
            rows.append((conditions, run.label, integer(len(e)), *cells, number(summarize(distance).min)))
        stated = {t: values for (name, t), values in paper.SHARES.items() if name == conditions}
        if stated:
            for place, (method, best) in enumerate((("ACT, paper", 0.18), ("ACT, paper's rollouts", 0.186))):
                cells = [
                    Cell(f"{stated[t][place]:.0f} %", stated[t][place] / 100) if t in stated else "" for t in LADDER_M
                ]
                reference.append(len(rows))
                rows.append(
                    (conditions, method, integer(100), *cells, number(best) if conditions == "same" else number(None))
                )
    notes = (
        f"{INTERVALS} Tolerances: the IDSS lateral limit, and those that the paper's text names.",
        *study.beside_the_paper(),
    )
    return Table("ladder", "Tolerance ladder", head, tuple(rows), notes, 2, frozenset(reference))


def conditions_table(study: Study) -> Table:
    """Each condition of the IDSS and ATV boxes by itself, and all together."""
    groups = list(study.groups())
    head = ("box", "condition", "limit", *(f"{run.label}, {name}" for name, run, _ in groups))
    rows = []
    for box, names, total in ((IDSS, IDSS_CONDITIONS, "idss"), (ATV, ATV_CONDITIONS, "atv")):
        for name in (*names, total):
            plain = name.partition("_")[2].replace("_", " ") or "all together"
            cells = (flag_share(e, name) for _, _, e in groups)
            rows.append((total.upper(), plain, _limit(box, name.partition("_")[2]), *cells))
    notes = (
        INTERVALS,
        "Limits hold on the limit itself. Of a flight that reached no plane, the conditions one by one are of its "
        "last state. ATV: closing speed and lateral offset alone of the probe-and-drogue limits at Zvezda aft.",
    )
    return Table("conditions", "Docking conditions, one by one", head, tuple(rows), notes, 3)


def contact_table(study: Study) -> Table:
    """The state in which the boxes were judged: mean and 95th percentile."""
    chosen = [BY_NAME[name] for name in CONTACT_NUMBERS]
    head = ("set", "run", "crossed the plane", "n", *(f"{m.label} ({m.unit})" for m in chosen))
    rows = []
    for conditions, run, e in study.groups():
        cells = []
        for metric in chosen:
            s = summarize(e.values(metric.name))
            text = f"{number(s.mean).text} / {number(s.p95).text}"
            cells.append(Cell(text, {"mean": s.mean, "p95": s.p95, "n": s.n}))
        counted = integer(len(e.values("lateral_m")))
        rows.append((conditions, run.label, flag_share(e, "crossed"), counted, *cells))
    notes = (
        "Mean / 95th percentile over the n episodes that have such a state: where the task is to touch the port, those "
        "that crossed its plane; in the fixed-horizon task all, at the last state. Roll and its rate: absolute values. "
        + INTERVALS,
    )
    return Table("contact", "State at contact", head, tuple(rows), notes, 2)


def safety_table(study: Study) -> Table:
    """Corridor, fly-throughs, closest approach, attitude and rate errors, and time."""
    names = ("final_misalignment_deg", "final_rate_deg_s", "closest_approach_m", "duration_s")
    head = (
        "set",
        "run",
        "success",
        "left the corridor",
        "flew through",
        *(f"{BY_NAME[name].label} ({BY_NAME[name].unit})" for name in names),
    )
    rows = []
    for conditions, run, e in study.groups():
        flags = (flag_share(e, name) for name in ("success", "corridor_violated", "fly_through"))
        means = (_mean_or_unstated(e, name) for name in names)
        rows.append((conditions, run.label, *flags, *means))
    notes = (
        "Success: as the log states it, else the IDSS box. Corridor: the cone about the port axis that the log states, "
        "by default 10° to either side from a mouth of 1.5 m. Flew through: passed the port plane, outside the IDSS "
        "box both there and where the box was judged. Right of them means. " + INTERVALS,
    )
    return Table("safety", "Approach", head, tuple(rows), notes, 2)


def flag_share(episodes: EpisodeSet, name: str) -> Cell:
    """Share of episodes with a flag set, with its interval."""
    return _share(*episodes.count(name))


def _share(successes: int, n: int) -> Cell:
    interval = clopper_pearson(successes, n)
    return share(successes, n, interval.low, interval.high)


def _mean_or_unstated(episodes: EpisodeSet, name: str) -> Cell:
    values = episodes.values(name)
    return number(float(values.mean())) if len(values) else Cell("not stated", None)


def _limit(box: ContactBox, condition: str) -> str:
    if not condition:
        return ""
    if condition == "closing_speed":
        return f"{box.closing_speed_m_s[0]:.2f}–{box.closing_speed_m_s[1]:.2f} m/s"
    for suffix, unit in (("_m", "m"), ("_m_s", "m/s"), ("_deg", "°"), ("_deg_s", "°/s")):
        if hasattr(box, condition + suffix):
            return f"≤ {getattr(box, condition + suffix):g} {unit}"
    raise AssertionError(condition)
