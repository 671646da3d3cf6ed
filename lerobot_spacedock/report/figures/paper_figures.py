"""Figures 3–7 of the paper, over the runs given."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from scipy import stats

from lerobot_spacedock.metrics.collect import EpisodeSet, Trace
from lerobot_spacedock.metrics.paired import normal_quantiles
from lerobot_spacedock.metrics.visitation import density
from lerobot_spacedock.report.figures.style import GRID, INK, LIMIT, MUTED, Figure, Panel, run_style
from lerobot_spacedock.report.model import Run, Study
from lerobot_spacedock.report.paper import SMOOTHNESS

RING_M = 2.0
BAR_SHARE = 0.24  # of a panel's width, for a colour bar with its numbers and its unit
PLANES = (("XY", 0, "yx"), ("ZY", 2, "yz"))  # the paper's names; y runs along the approach


def figure3(study: Study, conditions: str) -> Figure:
    """Trajectories in both planes, with the ring of 2 m about the port."""
    flown = list(study.flown(conditions))
    limits = _window([e for _, e in flown])
    panels = tuple(
        Panel(
            f"{run.label}, {plane}",
            lambda ax, run=run, e=e, axis=axis: _trajectories(ax, study, run, e, axis, limits),
        )
        for run, e in flown
        for plane, axis, _ in PLANES
    )
    counts = ", ".join(f"{run.label} {len(e.traces)} of {len(e):,}" for run, e in flown)
    return Figure(
        f"figure3_{conditions}",
        f"Figure 3. Trajectories, starts “{conditions}”",
        f"Position in m, port at the origin, ring of {RING_M:.0f} m about it (axes not to one scale); dots: last "
        f"states. Episodes drawn: {counts}.",
        panels,
    )


def figure4(study: Study, conditions: str) -> Figure:
    """Distribution of the smoothness metric."""
    flown = [(run, e.values("smoothness")) for run, e in study.flown(conditions)]

    def draw(ax: Axes) -> None:
        top = max((float(v.max()) for _, v in flown if len(v)), default=1.0)
        low = min((float(v.min()) for _, v in flown if len(v)), default=0.0)
        widths = [float(v.std(ddof=1)) * len(v) ** -0.2 for _, v in flown if len(v) > 1]  # Scott's, of each kernel
        pad = max(0.06 * max(top - low, 0.1), 3.0 * max(widths, default=0.0))  # the curves come down within the axes
        grid = np.linspace(max(0.0, low - pad), top + pad, 400)
        for run, values in flown:
            style = run_style(study.colour(run))
            if len(values) > 1 and np.ptp(values) > 1e-9 * max(1.0, top):
                curve = stats.gaussian_kde(values)(grid)
                ax.plot(grid, curve, color=style["color"], ls=style["linestyle"], label=run.label)
                ax.fill_between(grid, curve, color=style["color"], alpha=0.18, lw=0)
            else:
                for value in values[:1]:
                    ax.axvline(value, color=style["color"], ls=style["linestyle"], label=run.label)
            shown = values if len(values) <= 500 else np.quantile(values, np.linspace(0, 1, 500))
            ax.plot(shown, np.zeros(len(shown)), "|", color=style["color"], ms=7, alpha=0.6, clip_on=False)
        ax.set(xlabel="mean ‖Δa‖ of an episode (N, N·m mixed)", ylabel="density", xlim=(grid[0], grid[-1]))
        ax.set_ylim(bottom=0)
        ax.legend()

    mine = [p for p in SMOOTHNESS if p.conditions.split()[0] == conditions]
    beside = "; ".join(f"{p.method} {p.mean} ± {p.std}" for p in mine)
    caption = "Gaussian kernel estimate (Scott's width); ticks: episodes."
    return Figure(
        f"figure4_{conditions}",
        f"Figure 4. Smoothness of the commands, starts “{conditions}”",
        caption + (f" For comparison: {beside}." if beside else ""),
        (Panel("Smoothness (Eq. 4)", draw),),
        columns=1,
        panel_in=(6.2, 3.4),
    )


def figure5(study: Study, conditions: str) -> Figure:
    """Commands over one episode of each run: norms of thrust and torque, then each axis."""
    flown = [(run, e.traces[0]) for run, e in study.flown(conditions) if e.traces and len(e.traces[0].action)]

    def norm(columns: slice, unit: str, name: str) -> Panel:
        return Panel(
            f"{name}, norm",
            lambda ax: _steps(ax, study, flown, lambda t: np.linalg.norm(t.action[:, columns], axis=1), unit),
        )

    def axis(column: int, unit: str, name: str) -> Panel:
        return Panel(name, lambda ax: _steps(ax, study, flown, lambda t: t.action[:, column], unit))

    thrust = norm(slice(0, 3), "N", "Thrust")
    panels = [Panel(thrust.title, lambda ax: _named(ax, thrust.draw)), norm(slice(3, 6), "N·m", "Torque")]
    for k, letter in enumerate("xyz"):
        panels += [axis(k, "N", f"Thrust {letter}"), axis(3 + k, "N·m", f"Torque {letter}")]
    shown = ", ".join(f"{run.label}: {trace.name}" for run, trace in flown)
    return Figure(
        f"figure5_{conditions}",
        f"Figure 5. Commands over an episode, starts “{conditions}”",
        f"First episode of each run, body axes, held over each step. {shown}.",
        tuple(panels),
        panel_in=(4.2, 2.3),
    )


def figure6(study: Study, conditions: str) -> Figure:
    """Visitation density in both planes, contours on a common scale."""
    flown = list(study.flown(conditions))
    (y0, y1), (w0, w1) = _window([e for _, e in flown])
    maps = {(run.label, key): density(e.visits[key], (y0, y1), (w0, w1)) for run, e in flown for _, _, key in PLANES}
    top = max(float(grid.max()) for _, _, grid in maps.values()) or 1.0
    levels = top * np.geomspace(0.005, 1.0, 10)
    panels = tuple(
        Panel(
            f"{run.label}, {plane}",
            lambda ax, m=maps[run.label, key], plane=plane: _contours(ax, m, levels, plane[0].lower()),
        )
        for run, _ in flown
        for plane, _, key in PLANES
    )
    visits = ", ".join(f"{run.label} {e.visits['yx'].total:,}" for run, e in flown)
    return Figure(
        f"figure6_{conditions}",
        f"Figure 6. Visitation density, starts “{conditions}”",
        f"Share of all visited states per m², smoothed by 0.2 m; the same levels in every panel, in steps of equal "
        f"ratio, lowest at 0.5 % of the highest. States: {visits}.",
        panels,
    )


def figure7(study: Study, conditions: str) -> Figure:
    """Normal Q–Q plots of the smoothness metric."""
    panels = tuple(
        Panel(run.label, lambda ax, run=run, e=e: _normal_plot(ax, study, run, e)) for run, e in study.flown(conditions)
    )
    return Figure(
        f"figure7_{conditions}",
        f"Figure 7. Normal Q–Q plots of smoothness, starts “{conditions}”",
        "Ordered values against normal quantiles (Filliben's medians); line: sample mean and standard deviation.",
        panels,
        panel_in=(3.6, 3.1),
    )


def _window(sets: list[EpisodeSet]) -> tuple[tuple[float, float], tuple[float, float]]:
    """A window that holds the approach: 99.5 % of the traces' states, the port and its ring."""
    xyz = np.concatenate([trace.state[:, :3] for e in sets for trace in e.traces])
    y0, y1 = np.percentile(xyz[:, 1], [0.25, 99.75])
    across = float(np.percentile(np.abs(xyz[:, [0, 2]]), 99.5))
    half = 1.1 * max(across, RING_M)
    return (float(min(y0, -RING_M)) - 1.0, float(max(y1, RING_M)) + 1.0), (-half, half)


def _trajectories(ax: Axes, study: Study, run: Run, episodes: EpisodeSet, axis: int, window: tuple) -> None:
    color = run_style(study.colour(run))["color"]
    lines = [trace.state[:, [1, axis]] for trace in episodes.traces]
    ax.add_collection(LineCollection(lines, colors=[color], linewidths=0.6, alpha=max(0.12, min(0.8, 12 / len(lines)))))
    ends = np.array([line[-1] for line in lines])
    ax.plot(ends[:, 0], ends[:, 1], ".", ms=3.0, color=color)
    ax.add_patch(Circle((0, 0), RING_M, fill=False, ec=LIMIT, lw=1.2))
    ax.plot(0, 0, "+", color=INK, ms=7)
    ax.set(xlabel="y (m)", ylabel=f"{'xyz'[axis]} (m)", xlim=window[0], ylim=window[1])


def _steps(ax: Axes, study: Study, flown: list[tuple[Run, Trace]], take, unit: str) -> None:
    for run, trace in flown:
        style = run_style(study.colour(run))
        ax.stairs(take(trace), trace.time, baseline=None, color=style["color"], ls=style["linestyle"], label=run.label)
    ax.set(xlabel="time (s)", ylabel=unit)


def _named(ax: Axes, draw: Callable[[Axes], None]) -> None:
    """A panel that names the runs for all of its figure, above the curves."""
    draw(ax)
    rows = len(ax.get_legend_handles_labels()[0])
    if rows:
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + (high - low) * 0.13 * rows)
        ax.legend(loc="upper right")


def _contours(ax: Axes, plane_map: tuple, levels: np.ndarray, letter: str) -> None:
    y, w, grid = plane_map
    if grid.max() >= levels[0]:
        filled = ax.contourf(y, w, grid, levels=levels, cmap="viridis", norm="log", extend="max")
        shown = levels[[0, 3, 6, 9]]
        ticks = {"ticks": FixedLocator(shown), "format": FuncFormatter(_short)}
        bar = ax.figure.colorbar(filled, ax=ax, pad=0.02, fraction=BAR_SHARE, **ticks)
        bar.ax.yaxis.set_minor_locator(NullLocator())
        bar.set_label("1/m²")
        bar.outline.set_edgecolor(GRID)
    ax.add_patch(Circle((0, 0), RING_M, fill=False, ec=LIMIT, lw=1.2))
    ax.set(xlabel="y (m)", ylabel=f"{letter} (m)", xlim=(y[0], y[-1]), ylim=(w[0], w[-1]))


def _normal_plot(ax: Axes, study: Study, run: Run, episodes: EpisodeSet) -> None:
    values = episodes.values("smoothness")
    quantiles, ordered = normal_quantiles(values)
    style = run_style(study.colour(run))
    ax.plot(quantiles, ordered, style["marker"], ms=3.5, color=style["color"], alpha=0.7, mec="none")
    if len(values) > 1:
        ends = np.array([quantiles[0], quantiles[-1]])
        ax.plot(ends, values.mean() + values.std(ddof=1) * ends, color=MUTED, lw=1)
    ax.set(xlabel="normal quantile", ylabel="‖Δa‖ (N, N·m mixed)")


def _short(value: float, _: object = None) -> str:
    return f"{value:.2g}"
