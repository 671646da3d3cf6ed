"""Figures: every word lies whole in its panel, axes can be read, and one episode is enough to be seen."""

import dataclasses
from itertools import pairwise

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from synthetic_logs import write_run

from lerobot_spacedock.report.build import ReportConfig, load_study
from lerobot_spacedock.report.figures.docking_figures import error_figure
from lerobot_spacedock.report.figures.paper_figures import figure4
from lerobot_spacedock.report.figures.style import _canvas, plain_log, styled
from lerobot_spacedock.report.write import make_figures

LONG = "ACT with its temporal ensemble, all 48 predictions of a moment"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    root = tmp_path_factory.mktemp("figures")
    write_run(root / "a", range(3), jitter=1.0)
    write_run(root / "b", range(1), jitter=4.0)
    return load_study(ReportConfig(runs=[f"{LONG}={root / 'a'}", f"one={root / 'b'}"], resamples=100))


def drawn(canvas):
    """Draws, and gives each text that shows with its box, pixels."""
    renderer = FigureCanvasAgg(canvas).get_renderer()
    canvas.draw(renderer)
    hidden = set()
    for axes in canvas.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not low <= tick.get_loc() <= high:  # made, and not drawn
                    hidden |= {tick.label1, tick.label2}
    texts = (text for text in canvas.findobj(Text) if text not in hidden and text.get_visible())
    return [(text.get_text(), text.get_window_extent(renderer)) for text in texts if text.get_text().strip()]


def test_no_word_is_cut_off(study):
    for figure in make_figures(study):
        for panel in figure.panels:
            with styled():
                canvas = _canvas(figure, (panel,), 1)
                for word, box in drawn(canvas):
                    inside = box.x0 > -1 and box.y0 > -1 and box.x1 < canvas.bbox.x1 + 1 and box.y1 < canvas.bbox.y1 + 1
                    assert inside, (figure.key, panel.title, word)


def test_the_curves_of_smoothness_come_down_within_the_axes(study):
    figure = figure4(dataclasses.replace(study, runs=study.runs[:1]), "same")
    axes = _canvas(figure, figure.panels, 1).axes[0]
    (curve,) = [line for line in axes.lines if line.get_label() == LONG]
    density = curve.get_ydata()
    assert max(density[0], density[-1]) < 0.02 * max(density)


def test_one_episode_shows_in_the_cumulative_shares(study):
    canvas = _canvas(error_figure(study, "same"), error_figure(study, "same").panels[:1], 1)
    (line,) = [line for line in canvas.axes[0].lines if line.get_label() == "one"]
    assert list(line.get_ydata()) == [0.0, 1.0]
    assert len(set(line.get_xdata())) == 1


@pytest.mark.parametrize("low", [0.00037, 0.07, 0.4, 3.0, 18.0])
@pytest.mark.parametrize("span", [1.06, 1.9, 2.4, 2.6, 9.0, 30.0, 99.0, 250.0, 5000.0])
@pytest.mark.parametrize("name", ["xaxis", "yaxis"])
def test_a_logarithmic_axis_has_labels_that_can_be_read(low, span, name):
    with styled():
        canvas = Canvas(figsize=(4.2, 3.1))
        axes = canvas.add_axes((0.16, 0.15, 0.8, 0.76), xscale="log", yscale="log")
        getattr(axes, f"set_{name[0]}lim")(low, low * span)
        plain_log(getattr(axes, name), low, low * span)
        getattr(axes, "yaxis" if name == "xaxis" else "xaxis").set_ticks([], minor=False)
        labels = [box for word, box in drawn(canvas) if not word.startswith("$")]
    assert len(labels) >= 2
    first, last = (("x0", "x1"), ("y0", "y1"))[name == "yaxis"]
    labels.sort(key=lambda box: getattr(box, first))
    gaps = [getattr(b, first) - getattr(a, last) for a, b in pairwise(labels)]
    assert min(gaps) > 2.0, gaps
