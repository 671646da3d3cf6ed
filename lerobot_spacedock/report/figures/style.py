"""How figures look: Okabe and Ito's colours, told apart by line and marker as well, inks that the page can change."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe and Ito 2008
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P")
INK = "#1b1b1f"
MUTED = "#6b6b76"
GRID = "#d9d9e0"
LIMIT = "#9a6700"  # boxes, gates, rings: what a state is measured against
# on the page a run's colour is a variable too: the stylesheet lightens it on a dark ground
_PAGE_COLOURS = {colour.lower(): f"var(--run{i})" for i, colour in enumerate(COLOURS)}
_PAGE_COLOURS |= {INK: "var(--ink)", MUTED: "var(--muted)", GRID: "var(--grid)", LIMIT: "var(--limit)"}
PANEL_IN = (4.2, 3.1)
MARGINS_IN = (0.68, 0.14, 0.46, 0.28)  # left, right, bottom, top of each panel
EDGE_IN, LEGEND_KEYS_IN = 0.1, 0.7  # what a title leaves free, and a legend takes beside its words
LINEAR_BELOW = 2.5  # times: a logarithmic axis that spans less has evenly spaced labels
DPI = 160

RC = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.labelsize": 9,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "spacedock",
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}


@dataclass(frozen=True)
class Panel:
    """One set of axes: ``draw`` fills it."""

    title: str
    draw: Callable[[Axes], None]


@dataclass(frozen=True)
class Figure:
    """A figure of panels.

    Attributes:
        key: file name and anchor, for example ``figure3_same``.
        title: one line.
        caption: what is drawn, with units and counts.
        panels: in reading order.
        columns: panels a row, for paper.
        panel_in: width and height of a panel in inches.
    """

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 2
    panel_in: tuple[float, float] = PANEL_IN


@contextmanager
def styled() -> Iterator[None]:
    """Our settings for as long as drawing lasts; the caller's matplotlib is left as it was."""
    with matplotlib.rc_context(RC):
        yield


def run_style(place: int) -> dict[str, object]:
    """Colour, line and marker of the run at this place; beyond six they repeat in another pairing."""
    n = len(COLOURS)
    return {
        "color": COLOURS[place % n],
        "linestyle": LINES[(place + place // n) % n],
        "marker": MARKERS[(place + 2 * (place // n)) % n],
    }


def write_paper_files(figure: Figure, folder: Path) -> list[Path]:
    """The whole figure as PNG (white ground) and SVG. Returns the paths written."""
    columns = min(figure.columns, len(figure.panels))
    paths = [folder / f"{figure.key}.png", folder / f"{figure.key}.svg"]
    with styled():
        canvas = _canvas(figure, figure.panels, columns)
        canvas.savefig(paths[0], dpi=DPI, facecolor="white")
        canvas.savefig(paths[1], facecolor="white", metadata={"Date": None})
    return paths


def panel_svgs(figure: Figure) -> list[str]:
    """Each panel as an SVG element for the page: clear ground, inks as CSS variables, ids of its own."""
    elements = []
    with styled():
        for index, panel in enumerate(figure.panels):
            buffer = io.StringIO()
            _canvas(figure, (panel,), 1).savefig(buffer, format="svg", metadata={"Date": None})
            elements.append(_for_page(buffer.getvalue(), f"{figure.key}-{index}", panel.title))
    return elements


def _canvas(figure: Figure, panels: tuple[Panel, ...], columns: int) -> Canvas:
    """Panels on a grid of equal cells, with margins in inches: a layout engine takes most of a report's time."""
    rows = -(-len(panels) // columns)
    width, height = figure.panel_in
    canvas = Canvas(figsize=(width * columns, height * rows))
    left, right, bottom, top = MARGINS_IN
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        box = (
            (column + left / width) / columns,
            (rows - 1 - row + bottom / height) / rows,
            (1.0 - (left + right) / width) / columns,
            (1.0 - (bottom + top) / height) / rows,
        )
        axes = canvas.add_axes(box)
        panel.draw(axes)
        axes.set_title(panel.title)
        _fit(axes, column * width, (column + 1) * width)
    return canvas


def _fit(axes: Axes, left_in: float, right_in: float) -> None:
    """Long names in smaller type: the title within its cell, the legend within its axes."""
    box = axes.get_position()
    canvas_in = axes.figure.get_size_inches()[0]
    centre = 0.5 * (box.x0 + box.x1) * canvas_in
    _shrink([axes.title], 2.0 * min(centre - left_in, right_in - centre) - EDGE_IN)
    if axes.get_legend():
        _shrink(axes.get_legend().get_texts(), box.width * canvas_in - LEGEND_KEYS_IN)


def _shrink(texts: Sequence[Text], room_in: float) -> None:
    """All of these lines by as much as the longest needs."""
    widest = max((_width_in(text) for text in texts), default=0.0)
    for text in texts if widest > room_in else ():
        text.set_fontsize(text.get_fontsize() * room_in / widest)


def _width_in(text: Text) -> float:
    points, _, _ = text_to_path.get_text_width_height_descent(text.get_text(), text.get_fontproperties(), False)
    return points / 72.0


def plain_log(axis: Axis, low: float, high: float) -> None:
    """Labels as people write them on a logarithmic axis from ``low`` to ``high``, as many as can be read."""
    span = high / low
    if span < LINEAR_BELOW:
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))  # tens and simple shares are too far apart
    elif span < 10.0:
        axis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    else:
        room = 100.0 if axis.axis_name == "x" else 1e4  # words are wider than high
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if span < room else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _for_page(svg: str, prefix: str, label: str) -> str:
    svg = svg[svg.index("<svg") :].rstrip()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.S)
    for ink, variable in _PAGE_COLOURS.items():
        svg = svg.replace(ink, variable)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'(xlink:href|href)="#', rf'\1="#{prefix}-', svg)
    svg = svg.replace("url(#", f"url(#{prefix}-")
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    name = label.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return svg.replace("<svg", f'<svg role="img" aria-label="{name}"', 1)
