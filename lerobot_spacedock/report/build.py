"""``spacedock report``: episode logs in; tables, figures and one page out."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tqdm import tqdm

from lerobot_spacedock.episode_log import POLICY_FILE
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.folders import check_writable
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.report.model import Run, Study
from lerobot_spacedock.report.runs import log_files, parse_runs
from lerobot_spacedock.report.samples import read_samples


@dataclass
class ReportConfig:
    """Tables, figures and one page from episode logs, whoever wrote them."""

    # Runs to compare: label=folder of episode logs; label=folder,folder for several training seeds of one run
    runs: list[str] = field(default_factory=list)
    # Folder to write; made if absent, files of the same names are replaced
    out: Path = Path("report")
    # What trained a policy: label=file.json with "episodes" and "interactions" (as train-expert writes); left out,
    # what the evaluation wrote beside the logs
    training: list[str] = field(default_factory=list)
    # What an imitator learned from: label=root of its LeRobotDataset; left out, what the evaluation wrote
    demos: list[str] = field(default_factory=list)
    # Label of the run whose Δv the others are set against; default: the run that is called MPC, if there is one
    reference: str | None = None
    # Title of the page
    title: str = "SpaceDock evaluation"
    # Bootstrap resamples, 100 or more
    resamples: int = 2000
    # Processes that read logs; default: one a core where there are many files
    workers: int | None = None


def load_study(cfg: ReportConfig) -> Study:
    """Reads every log of every run, once.

    Raises:
        InputError: options that cannot be used, or a run without a readable episode.
    """
    specs = parse_runs(cfg.runs)
    labels = [spec.label for spec in specs]
    reference = _reference(cfg.reference, labels)
    if cfg.resamples < 100:
        raise InputError("--resamples", cfg.resamples, "100 or more")
    if cfg.workers is not None and cfg.workers < 1:
        raise InputError("--workers", cfg.workers, "1 or more")
    files = [[log_files(folder) for folder in spec.folders] for spec in specs]
    records = {
        spec.label: [folder[0].parent / POLICY_FILE for folder in folders]
        for spec, folders in zip(specs, files, strict=True)
    }
    samples = read_samples(cfg.training, cfg.demos, records)
    total = sum(len(folder) for run in files for folder in run)
    runs = []
    with tqdm(total=total, unit="episode", desc="reading logs", file=sys.stderr, disable=total < 50) as bar:
        for spec, folders in zip(specs, files, strict=True):
            sets, exclusions = collect(folders, workers=cfg.workers, progress=bar)
            if not sets:
                why = exclusions[0].reason if exclusions else "no file"
                raise InputError("--runs", spec.label, "at least one episode that counts", f"First file: {why}")
            runs.append(Run(spec, sets, exclusions, samples.get(spec.label)))
    return Study(runs, reference)


def report(cfg: ReportConfig) -> int:
    """Writes the report and says where it is.

    Raises:
        InputError, FileFormatError: as ``load_study``; or a folder that cannot be written.
    """
    check_writable(cfg.out, "--out")  # it is used last
    study = load_study(cfg)
    from lerobot_spacedock.report.write import write_report  # matplotlib only once the logs could be read

    page = write_report(study, cfg)
    excluded = sum(len(run.exclusions) for run in study.runs)
    episodes = sum(len(episodes) for _, _, episodes in study.groups())
    print(f"{episodes:,} episodes counted, {excluded} excluded" + (" (reasons on the page)" if excluded else ""))
    print(f"Report: {page}")
    print(f"Tables: {page.parent / 'report.md'}, {page.parent / 'tables.tex'}; numbers: {page.parent / 'report.json'}")
    first = study.runs[0].spec.folders[0]
    print(f"Next: spacedock view --log={log_files(first)[0]} --save=approach.rrd")
    return 0


def stated_options(cfg: ReportConfig) -> dict[str, object]:
    """The options as JSON, for the record beside the numbers."""
    return json.loads(json.dumps(asdict(cfg), default=str))


def _reference(stated: str | None, labels: list[str]) -> str | None:
    if stated is None:
        return next((label for label in labels if re.match(r"mpc\b", label, re.IGNORECASE)), None)
    if stated not in labels:
        raise InputError("--reference", stated, " | ".join(labels))
    return stated
