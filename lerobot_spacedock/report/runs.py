"""``--runs label=dir[,dir…]`` and its kin: from words to folders, with errors that say what is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lerobot_spacedock.episode_log import SURPLUS_FOLDER
from lerobot_spacedock.errors import InputError

PATTERN = "episode_*.parquet"


@dataclass(frozen=True)
class RunSpec:
    """A label and the folders of its episode logs, one folder a training seed."""

    label: str
    folders: tuple[Path, ...]


def split_pairs(option: str, words: Sequence[str], what: str) -> dict[str, str]:
    """``["A=x", "B=y"]`` → ``{"A": "x", "B": "y"}``.

    Raises:
        InputError: a word without ``=``, an empty side, or a label given twice.
    """
    pairs: dict[str, str] = {}
    for word in words:
        label, mark, value = (part.strip() for part in str(word).partition("="))
        if not (label and mark and value):
            raise InputError(option, word, f"label={what}", f"For example: {option} ACT={what}.")
        if label in pairs:
            mend = "Several training seeds of one run: label=dir,dir." if option == "--runs" else "Give it once."
            raise InputError(option, f"the label {label!r} twice", "each label once", mend)
        pairs[label] = value
    return pairs


def parse_runs(words: Sequence[str]) -> tuple[RunSpec, ...]:
    """The runs of a report, in the order given.

    Raises:
        InputError: no run, a malformed word, a folder that does not exist, or one given twice.
    """
    if not words:
        raise InputError(
            "--runs", "nothing", "label=dir, at least once", "For example: --runs ACT=logs/act RL=logs/rl."
        )
    runs = []
    seen: dict[Path, str] = {}
    for label, value in split_pairs("--runs", words, "logs/act").items():
        folders = tuple(Path(part.strip()).expanduser() for part in value.split(",") if part.strip())
        if not folders:
            raise InputError("--runs", f"{label}={value}", "label=dir or label=dir,dir")
        for folder in folders:
            if not folder.is_dir():
                raise InputError("--runs", f"{label}={folder}", "a folder that exists", "Was the run evaluated?")
            if (other := seen.setdefault(folder.resolve(), label)) is not label:
                raise InputError("--runs", f"{folder} under {other!r} and {label!r}", "each folder once")
        if len({folder.resolve() for folder in folders}) < len(folders):
            raise InputError("--runs", f"{label}={value}", "each folder once")
        runs.append(RunSpec(label, folders))
    return tuple(runs)


def log_files(folder: Path) -> list[Path]:
    """The episode logs of a folder, in name order; where it holds none itself, those of its subfolders.

    Surplus episodes that an evaluation put aside come last; they are counted as excluded.

    Raises:
        InputError: there is none, or the folder holds several evaluations made in training.
    """
    files = sorted(folder.glob(PATTERN))
    if files:
        return files + sorted((folder / SURPLUS_FOLDER).glob(PATTERN))
    evaluations = sorted(folder.glob("evaluation_[0-9]*"))
    if len(evaluations) > 1:
        raise InputError(
            "--runs",
            f"{folder}, which holds {len(evaluations)} evaluations made in training",
            "one of them",
            f"The last is {evaluations[-1]}.",
        )
    if files := sorted(folder.rglob(PATTERN)):
        return files
    mend = "Evaluate with --env.log_dir to write them."
    raise InputError("--runs", str(folder), f"a folder with {PATTERN}", mend)
