"""The files of a report: Markdown, LaTeX, JSON, PNG and SVG, and the page."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lerobot_spacedock.metrics.catalog import BY_NAME
from lerobot_spacedock.metrics.statistics import summarize
from lerobot_spacedock.report import comparison_tables, docking_tables, effort_tables
from lerobot_spacedock.report.figures import docking_figures, paper_figures
from lerobot_spacedock.report.figures.style import Figure, panel_svgs, write_paper_files
from lerobot_spacedock.report.model import Study
from lerobot_spacedock.report.page import render_page
from lerobot_spacedock.report.paper import CITATION, ERRATA
from lerobot_spacedock.report.paper_tables import table1, table2, table3, table4
from lerobot_spacedock.report.table import Table, to_json, to_latex, to_markdown

if TYPE_CHECKING:
    from lerobot_spacedock.report.build import ReportConfig

LATEX_HEAD = "% \\usepackage{booktabs,graphicx} is all that these tables need\n\n"


def make_tables(study: Study, cfg: ReportConfig) -> list[Table]:
    """Every table, in the page's order."""
    tables = [
        docking_tables.at_a_glance(study),
        table1(study),
        table2(study),
        table3(study),
        table4(study),
        docking_tables.ladder(study),
        docking_tables.conditions_table(study),
        docking_tables.contact_table(study),
        docking_tables.safety_table(study),
        comparison_tables.intervals_table(study, cfg.resamples),
        comparison_tables.pairs_table(study),
        comparison_tables.matched_table(study),
        comparison_tables.seeds_table(study),
        effort_tables.effort_table(study),
        effort_tables.smoothness_table(study),
        effort_tables.inference_table(study),
    ]
    return [table for table in tables if table is not None]


def make_figures(study: Study) -> list[Figure]:
    """Every figure, in the page's order, once a set of initial conditions."""
    makers = (
        paper_figures.figure3,
        paper_figures.figure4,
        paper_figures.figure5,
        paper_figures.figure6,
        paper_figures.figure7,
        docking_figures.contact_figure,
        docking_figures.range_rate_figure,
        docking_figures.error_figure,
        docking_figures.effort_figure,
    )
    return [make(study, conditions) for make in makers for conditions in study.conditions()]


def write_report(study: Study, cfg: ReportConfig) -> Path:
    """Writes everything into ``cfg.out``. Returns the page."""
    from lerobot_spacedock.report.build import stated_options

    out = Path(cfg.out)
    images = out / "figures"
    images.mkdir(parents=True, exist_ok=True)
    tables, figures = make_tables(study, cfg), make_figures(study)
    for figure in figures:
        write_paper_files(figure, images)
    (out / "report.md").write_text(_markdown(study, cfg, tables, figures), encoding="utf-8")
    (out / "tables.tex").write_text(LATEX_HEAD + "\n".join(to_latex(table) for table in tables), encoding="utf-8")
    numbers = {
        "title": cfg.title,
        "options": stated_options(cfg),
        "paper": CITATION,
        "runs": [_run_json(study, run) for run in study.runs],
        "tables": {table.key: to_json(table) for table in tables},
        "errata": [dict(zip(("subject", "paper", "finding"), row, strict=True)) for row in ERRATA],
    }
    (out / "report.json").write_text(_lines(numbers), encoding="utf-8")
    page = out / "index.html"
    page.write_text(render_page(study, cfg.title, tables, [(f, panel_svgs(f)) for f in figures]), encoding="utf-8")
    return page


def _lines(numbers: dict[str, Any], depth: int = 6) -> str:
    """JSON with a line an entry down to ``depth``: ``indent`` would give each of a million numbers its own, slowly."""

    def text(value: Any, level: int) -> str:
        if level == depth or not isinstance(value, dict | list) or not value:
            return json.dumps(value, ensure_ascii=False, allow_nan=False)
        pad = "\n" + " " * (level + 1)
        if isinstance(value, list):
            return f"[{pad}" + f",{pad}".join(text(item, level + 1) for item in value) + f"{pad[:-1]}]"
        items = (f"{json.dumps(str(key), ensure_ascii=False)}: {text(item, level + 1)}" for key, item in value.items())
        return f"{{{pad}" + f",{pad}".join(items) + f"{pad[:-1]}}}"

    return text(numbers, 0) + "\n"


def _run_json(study: Study, run) -> dict[str, Any]:
    sets = {}
    for conditions, episodes in run.sets.items():
        metrics = {}
        for name, column in episodes.columns.items():
            values = column[~np.isnan(column)]
            if name in BY_NAME and BY_NAME[name].kind == "number":
                metrics[name] = asdict(summarize(values, name)) | {"unit": BY_NAME[name].unit}
            else:
                metrics[name] = {"true": int(values.sum()), "n": len(values)}
            metrics[name]["undefined"] = int(np.isnan(column).sum())
        per_episode = {
            name: [None if np.isnan(v) else float(v) for v in column] for name, column in episodes.columns.items()
        }
        sets[conditions] = {
            "episodes": len(episodes),
            "files": episodes.names,
            "metrics": metrics,
            "per_episode": per_episode,
        }
    return {
        "label": run.label,
        "task": asdict(run.task),
        "folders": [str(folder) for folder in run.spec.folders],
        "sets": sets,
        "excluded": [asdict(exclusion) for exclusion in run.exclusions],
    }


def _markdown(study: Study, cfg: ReportConfig, tables: list[Table], figures: list[Figure]) -> str:
    parts = [f"# {cfg.title}\n", "## Tables\n", *(to_markdown(table) for table in tables), "## Figures\n"]
    parts += [f"### {f.title}\n\n![{f.title}](figures/{f.key}.png)\n\n{f.caption}\n" for f in figures]
    parts.append("## Excluded episodes\n")
    excluded = [(run.label, x) for run in study.runs for x in run.exclusions]
    parts += [f"- {label}: `{x.path}`: {x.reason}" for label, x in excluded] or ["None: every episode counts."]
    parts.append(f"\n## Errata of the paper\n\n{CITATION}.\n\n| subject | the paper | finding |\n|:--|:--|:--|")
    parts += [f"| {subject} | {stated} | {finding} |" for subject, stated, finding in ERRATA]
    return "\n".join(parts) + "\n"
