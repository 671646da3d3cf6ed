"""The page: one self-contained HTML file, light and dark, for screen, phone and print."""

from __future__ import annotations

import html
from importlib import resources

from lerobot_spacedock.report.figures.style import COLOURS, Figure
from lerobot_spacedock.report.model import Study
from lerobot_spacedock.report.paper import CITATION, ERRATA
from lerobot_spacedock.report.table import Table, to_html

PIXELS_PER_INCH = 140
SHADED = "<p>Shaded rows hold the numbers of the paper, or of its published rollouts.</p>"


def render_page(study: Study, title: str, tables: list[Table], figures: list[tuple[Figure, list[str]]]) -> str:
    """The whole page as text.

    Args:
        study: the runs.
        title: head of the page.
        tables: in order; those whose key begins with ``table`` are the paper's.
        figures: each with its panels as SVG elements; those whose key begins with ``figure`` are the paper's.
    """
    css = resources.files("lerobot_spacedock.report").joinpath("page.css").read_text(encoding="utf-8")
    paper_tables = [t for t in tables if t.key.startswith("table")]
    paper_figures = [f for f in figures if f[0].key.startswith("figure")]
    first = [t for t in tables if t.key == "glance"]
    more_tables = [t for t in tables if t not in paper_tables and t not in first]
    more_figures = [f for f in figures if f not in paper_figures]
    sections = [
        ("first", "At a glance", "".join(map(to_html, first))),
        ("paper-tables", "The paper's tables", SHADED + "".join(map(to_html, paper_tables))),
        ("paper-figures", "The paper's figures", "".join(_figure(study, *f) for f in paper_figures)),
        ("more-tables", "Docking, effort and statistics", "".join(map(to_html, more_tables))),
        ("more-figures", "Further figures", "".join(_figure(study, *f) for f in more_figures)),
        ("excluded", "Excluded episodes", _exclusions(study)),
        ("errata", "Errata of the paper", _errata()),
    ]
    sections = [section for section in sections if section[2]]
    links = "".join(f'<a href="#{key}">{name}</a>' for key, name, _ in sections)
    body = "".join(f'<section id="{key}"><h2>{name}</h2>{content}</section>' for key, name, content in sections)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{html.escape(title)}</title><style>{css}</style></head><body>"
        f"<header><h1>{html.escape(title)}</h1>{_runs(study)}</header><nav>{links}</nav><main>{body}</main>"
        f"<footer>Paper: {html.escape(CITATION)}.</footer></body></html>\n"
    )


def _runs(study: Study) -> str:
    items = []
    for place, run in enumerate(study.runs):
        counts = ", ".join(f"{name}: {len(episodes):,}" for name, episodes in run.sets.items())
        trained = max(episodes.training_seeds for episodes in run.sets.values())
        seeds = f"; {trained} training seeds" if trained > 1 else ""
        said = html.escape(f"{run.task}; {counts}{seeds}")
        items.append(f"<li>{_swatch(place)}<b>{html.escape(run.label)}</b> <span>{said}</span></li>")
    return f"<ul class=runs>{''.join(items)}</ul>"


def _swatch(place: int) -> str:
    return f'<i class=swatch style="background:var(--run{place % len(COLOURS)})"></i>'


def _figure(study: Study, figure: Figure, panels: list[str]) -> str:
    width = f"max-width:{figure.panel_in[0] * PIXELS_PER_INCH:.0f}px"  # few panels are not blown up
    body = "".join(f'<div class=panel style="{width}">{svg}</div>' for svg in panels)
    return (
        f'<figure class=plot id="{html.escape(figure.key)}"><figcaption>{html.escape(figure.title)}</figcaption>'
        f"<div class=panels>{body}</div><p class=note>{html.escape(figure.caption)}</p></figure>"
    )


def _exclusions(study: Study) -> str:
    rows = [(run.label, x.path, x.reason) for run in study.runs for x in run.exclusions]
    if not rows:
        return "<p>None: every episode that was found counts, whatever its outcome.</p>"
    body = "".join(
        "<tr>" + "".join(f"<td class=text>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f"<p>{len(rows)} files enter no number:</p><div class=scroll tabindex=0><table><thead><tr><th class=text>run"
        f"<th class=text>file<th class=text>reason</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _errata() -> str:
    rows = "".join(
        f"<div><dt>{html.escape(subject)}</dt><dd><q>{html.escape(stated)}</q></dd><dd>{html.escape(finding)}</dd></div>"
        for subject, stated, finding in ERRATA
    )
    return (
        "<p>What the paper states, and what its authors' published rollouts and data give instead.</p>"
        f"<dl class=errata>{rows}</dl>"
    )
