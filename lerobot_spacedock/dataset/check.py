"""``spacedock check``: the integrity of a dataset as one report; exit status 1 where something is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from lerobot_spacedock.dataset.findings import Report
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.next_commands import TRAINING_HINT, train_command
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.residuals import TOLERANCES
from lerobot_spacedock.dataset.roots import existing_root
from lerobot_spacedock.errors import FileFormatError, InputError, reading
from lerobot_spacedock.files import read_object, write_json
from lerobot_spacedock.folders import check_output

MAX_LINES = 30


@dataclass
class CheckConfig:
    """Check a dataset's integrity and physics."""

    # user/name of the dataset; not needed with --root
    repo_id: str = ""
    # its folder; by default LeRobot's own place for this repo_id, or where LeRobot has downloaded it to
    root: str | None = None
    # how many frames to decode, spread over the whole dataset
    sample_frames: int = 16
    # draw those frames again from their states and compare
    redraw: bool = True
    # warnings fail as well
    strict: bool = False
    # file into which the report goes as JSON
    json: str | None = None


def check(config: CheckConfig) -> int:
    """Runs the verb; see the module."""
    if not config.repo_id and config.root is None:
        raise InputError("--root", None, "the dataset's folder, or its --repo_id")
    if config.sample_frames < 0:
        raise InputError("--sample_frames", config.sample_frames, "0 or more")
    root = existing_root(config.repo_id, config.root, downloaded=True)
    if config.json is not None:
        check_output(Path(config.json), "--json")  # it is used last
    with tqdm(total=_stated_episodes(root), unit="episode", desc="Checking") as bar:
        report = check_dataset(root, sample_frames=config.sample_frames, redraw=config.redraw, progress=bar.update)
    print(text_of(report, root))
    if config.json is not None:
        Path(config.json).parent.mkdir(parents=True, exist_ok=True)
        write_json(Path(config.json), report.to_dict())
        print(f"Wrote {config.json}")
    passed = report.ok and not (config.strict and report.warnings)
    if passed:
        repo_id = config.repo_id or f"local/{root.resolve().name}"
        with reading(root, "a dataset that says how it was made"):
            reader = DatasetReader(root)
            print(f"Next: {' '.join(train_command(reader, repo_id, root))}")
            if reader.cameras:
                print(f"      {TRAINING_HINT}")
    return 0 if passed else 1


def _stated_episodes(root: Path) -> int | None:
    """For the bar; None where the dataset does not say, which is for the check to judge."""
    try:
        total = read_object(root / "meta" / "info.json").get("total_episodes")
    except FileFormatError:
        return None
    return total if isinstance(total, int) else None


def text_of(report: Report, root: Path) -> str:
    """The report for a person."""
    lines = [f"{root}: {report.episodes} episodes, {report.frames} frames"]
    for name, values in (("error", report.errors), ("warning", report.warnings), ("note", report.notes)):
        lines += [f"  {name}: {value}" for value in values[:MAX_LINES]]
        if len(values) > MAX_LINES:
            lines.append(f"  … and {len(values) - MAX_LINES} more {name}s")
    if report.worst:
        worst = ", ".join(f"{name} {value:.2g} (≤ {TOLERANCES[name]:g})" for name, value in report.worst.items())
        lines.append(f"  worst of each state against the command before it: {worst}")
    if report.psnr_dB is not None:
        least, median = report.psnr_dB
        lines.append(f"  frames match their states drawn again: least {least:.1f} dB, median {median:.1f} dB")
    done = ", ".join(f"{name} {count}" for name, count in sorted(report.checks.items()))
    lines.append(f"  checked: {done}")
    lines.append("  OK" if report.ok else f"  {len(report.errors)} error{'s' if len(report.errors) > 1 else ''}")
    return "\n".join(lines)
