"""Beyond the paper: contact against the boxes, range-rate against range, error curves, effort."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from lerobot_spacedock.metrics.collect import RANGE_GRID_M, EpisodeSet
from lerobot_spacedock.physics.constants import THRUST_LIMIT_N, CHASER_MASS_kg
from lerobot_spacedock.physics.contact import IDSS
from lerobot_spacedock.report.figures.style import LIMIT, MUTED, Figure, Panel, plain_log, run_style
from lerobot_spacedock.report.model import Run, Study

POINTS_DRAWN = 1000  # a run; beyond, evenly spaced episodes stand for all in scatter plots (said in the caption)


def contact_figure(study: Study, conditions: str) -> Figure:
    """The state at contact, two quantities at a time, with the IDSS box in each."""
    flown = list(study.flown(conditions))
    least, most = IDSS.closing_speed_m_s
    closing = most - least
    panels = (
        ("Rates at contact", "lateral_speed_m_s", "closing_speed_m_s", (0, least, IDSS.lateral_speed_m_s, closing)),
        ("Miss and closing rate", "lateral_m", "closing_speed_m_s", (0, least, IDSS.lateral_m, closing)),
        ("Attitude", "pitch_yaw_deg", "roll_deg", (0, 0, IDSS.pitch_yaw_deg, IDSS.roll_deg)),
        (
            "Angular rates",
            "pitch_yaw_rate_deg_s",
            "roll_rate_deg_s",
            (0, 0, IDSS.pitch_yaw_rate_deg_s, IDSS.roll_rate_deg_s),
        ),
    )
    drawn = ", ".join(f"{run.label} {min(len(e.values('lateral_m')), POINTS_DRAWN)} of {len(e):,}" for run, e in flown)
    return Figure(
        f"contact_{conditions}",
        f"Contact against the IDSS box, starts “{conditions}”",
        f"Shaded: the box. Axes hold the box and 98 % of the episodes; those beyond stand as crosses on the edge. "
        f"Episodes drawn (none of a flight without contact, where contact is the task): {drawn}.",
        tuple(
            Panel(title, lambda ax, x=x, y=y, box=box: _scatter(ax, study, flown, x, y, box))
            for title, x, y, box in panels
        ),
    )


def range_rate_figure(study: Study, conditions: str) -> Figure:
    """Closing rate against range: median and 5–95 % band, with the gates."""
    flown = list(study.flown(conditions))

    def panel(run: Run, e: EpisodeSet) -> Panel:
        return Panel(run.label, lambda ax: _closing(ax, study, run, e))

    return Figure(
        f"closing_{conditions}",
        f"Closing rate against range, starts “{conditions}”",
        "Line: median; band: 5–95 % of the episodes that reached this range. Gates: the IDSS closing rates at contact "
        f"(shaded), and the fastest approach that {THRUST_LIMIT_N:.0f} N of braking can still bring down to them "
        "(dashed).",
        tuple(panel(run, e) for run, e in flown),
        panel_in=(4.2, 2.9),
    )


def error_figure(study: Study, conditions: str) -> Figure:
    """Cumulative shares of final distance and speed."""
    flown = list(study.flown(conditions))

    def draw(ax: Axes, name: str, label: str) -> None:
        for run, e in flown:
            values = np.sort(e.values(name))
            style = run_style(study.colour(run))
            steps = np.arange(len(values) + 1) / max(1, len(values))
            positive = np.maximum(np.concatenate([values[:1], values]), 1e-6)  # the first step up, from 0, shows too
            ax.step(positive, steps, where="post", color=style["color"], ls=style["linestyle"], label=run.label)
        ax.set(xscale="log", xlabel=label, ylabel="share of episodes", ylim=(0, 1.02))
        plain_log(ax.xaxis, *ax.get_xlim())
        ax.legend()

    return Figure(
        f"errors_{conditions}",
        f"Final errors, starts “{conditions}”",
        "Share of episodes that end within the error on the axis (logarithmic).",
        (
            Panel("Final distance", lambda ax: draw(ax, "final_distance_m", "‖r_K‖ (m)")),
            Panel("Final speed", lambda ax: draw(ax, "final_speed_m_s", "‖v_K‖ (m/s)")),
        ),
    )


def effort_figure(study: Study, conditions: str) -> Figure:
    """Δv against final distance, an episode a point."""
    flown = list(study.flown(conditions))

    def draw(ax: Axes) -> None:
        for run, e in flown:
            style = run_style(study.colour(run))
            x, y = (_thin(e.columns[name]) for name in ("delta_v_m_s", "final_distance_m"))
            ax.plot(x, np.maximum(y, 1e-6), style["marker"], ms=3.5, color=style["color"], alpha=0.6, mec="none",
                    label=run.label)  # fmt: skip
        ax.set(xlabel="Δv (m/s)", ylabel="‖r_K‖ (m)", yscale="log")
        plain_log(ax.yaxis, *ax.get_ylim())
        ax.legend()

    return Figure(
        f"effort_{conditions}",
        f"Effort and accuracy, starts “{conditions}”",
        "An episode a point; lower left is better.",
        (Panel("Δv against final distance", draw),),
        columns=1,
        panel_in=(6.2, 3.4),
    )


def _thin(values: np.ndarray) -> np.ndarray:
    if len(values) <= POINTS_DRAWN:
        return values
    return values[np.linspace(0, len(values) - 1, POINTS_DRAWN).astype(int)]


def _scatter(ax: Axes, study: Study, flown: list, x_name: str, y_name: str, box: tuple) -> None:
    names = {"closing_speed_m_s": "closing rate (m/s)", "lateral_speed_m_s": "lateral rate (m/s)",
             "lateral_m": "lateral miss (m)", "pitch_yaw_deg": "pitch/yaw (°)", "roll_deg": "roll (°)",
             "pitch_yaw_rate_deg_s": "pitch/yaw rate (°/s)", "roll_rate_deg_s": "roll rate (°/s)"}  # fmt: skip
    x0, y0, width, height = box
    edges = []
    for name, far in ((x_name, x0 + width), (y_name, y0 + height)):
        values = np.concatenate([e.values(name) for _, e in flown])
        low, high = np.percentile(values, [1, 99]) if len(values) else (0.0, far)
        top = 1.12 * max(far, float(high))
        edges.append((min(-0.02 * top, 1.1 * float(low)), top))  # a little below 0: points on the axis show whole
    (left, right), (bottom, top) = edges
    ax.add_patch(Rectangle((x0, y0), width, height, fc=LIMIT, ec=LIMIT, alpha=0.18, lw=0))
    ax.add_patch(Rectangle((x0, y0), width, height, fill=False, ec=LIMIT, lw=1))
    for run, e in flown:
        style = run_style(study.colour(run))
        x, y = e.columns[x_name], e.columns[y_name]
        there = ~np.isnan(x + y)
        x, y = _thin(x[there]), _thin(y[there])
        inside = (x >= left) & (x <= right) & (y >= bottom) & (y <= top)
        ax.plot(
            x[inside], y[inside], style["marker"], ms=3.5, color=style["color"], alpha=0.6, mec="none", label=run.label
        )
        if not inside.all():  # a line without points that is not clipped upsets the layout
            outside = np.clip(x[~inside], left, right), np.clip(y[~inside], bottom, top)
            ax.plot(*outside, "x", ms=5, color=style["color"], clip_on=False)
    ax.locator_params(nbins=5)
    ax.set(xlim=(left, right), ylim=(bottom, top), xlabel=names[x_name], ylabel=names[y_name])
    ax.legend()


def _closing(ax: Axes, study: Study, run: Run, episodes: EpisodeSet) -> None:
    style = run_style(study.colour(run))
    reached = np.sum(~np.isnan(episodes.closing), axis=0)
    keep = reached >= max(1, 0.05 * len(episodes))
    if keep.any():
        grid = RANGE_GRID_M[keep]
        low, middle, high = np.nanpercentile(episodes.closing[:, keep], [5, 50, 95], axis=0)
        ax.fill_between(grid, low, high, color=style["color"], alpha=0.2, lw=0)
        ax.plot(grid, middle, color=style["color"], ls=style["linestyle"])
    least, most = IDSS.closing_speed_m_s
    ax.axhspan(least, most, color=LIMIT, alpha=0.22, lw=0)
    brake = np.sqrt(most**2 + 2.0 * THRUST_LIMIT_N / CHASER_MASS_kg * RANGE_GRID_M)
    ax.plot(RANGE_GRID_M, brake, "--", color=LIMIT, lw=1)
    ax.axhline(0, color=MUTED, lw=0.6)
    top = float(np.nanmax(episodes.closing[:, keep])) if keep.any() else most
    ax.set(xlabel="range (m)", ylabel="closing rate (m/s)", xlim=(RANGE_GRID_M[-1], 0))
    ax.set_ylim(top=1.15 * max(top, 2 * most))
