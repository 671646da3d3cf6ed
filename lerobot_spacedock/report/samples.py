"""How much a method saw: read from what its makers wrote down, never guessed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.report.model import Samples
from lerobot_spacedock.report.runs import split_pairs

EPISODE_KEYS = ("episodes", "training_episodes", "num_episodes")
INTERACTION_KEYS = ("interactions", "training_interactions", "env_steps", "steps")


def read_samples(training: Sequence[str], demos: Sequence[str], labels: Sequence[str]) -> dict[str, Samples]:
    """Counts by run label, for the runs that ``--training`` or ``--demos`` speak of.

    Raises:
        InputError: a label that is no run's, or a file that does not exist.
        FileFormatError: a file without the counts.
    """
    trained = split_pairs("--training", training, "training.json")
    shown = split_pairs("--demos", demos, "datasets/demos")
    for option, pairs in (("--training", trained), ("--demos", shown)):
        for label in pairs:
            if label not in labels:
                raise InputError(option, label, " | ".join(labels), "A label of --runs is meant.")
    samples = {}
    for label in {**trained, **shown}:
        counts: dict[str, int | None] = {}
        if label in trained:
            counts |= _training(Path(trained[label]).expanduser())
        if label in shown:
            counts |= _demonstrations(Path(shown[label]).expanduser())
        samples[label] = Samples(**counts)
    return samples


def _training(path: Path) -> dict[str, int | None]:
    record = _json("--training", path)
    nested = record.get("training")  # as beside an expert's checkpoint
    record = nested if isinstance(nested, dict) else record
    episodes = _first_count(record, EPISODE_KEYS)
    interactions = _first_count(record, INTERACTION_KEYS)
    if interactions is None:
        raise FileFormatError(f"{path}: no {' or '.join(repr(key) for key in INTERACTION_KEYS)} with a count.")
    return {"training_episodes": episodes, "training_interactions": interactions}


def _demonstrations(root: Path) -> dict[str, int | None]:
    info = _json("--demos", root / "meta" / "info.json")
    episodes, frames = (_first_count(info, (key,)) for key in ("total_episodes", "total_frames"))
    if episodes is None or frames is None:
        raise FileFormatError(f"{root}/meta/info.json: no 'total_episodes' and 'total_frames' with counts.")
    counts = {"demonstrations": episodes, "demonstration_interactions": frames}
    made = root / "meta" / "spacedock.json"
    if made.exists():
        selection = _json("--demos", made).get("selection")
        counts["flown_episodes"] = _first_count(selection if isinstance(selection, dict) else {}, ("flown",))
    return counts


def _json(option: str, path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(option, str(path), "a file that exists")
    try:
        record = json.loads(path.read_text())
    except ValueError as error:
        raise FileFormatError(f"{path}: not JSON ({error}).") from error
    if not isinstance(record, dict):
        raise FileFormatError(f"{path}: {type(record).__name__}, not a JSON object.")
    return record


def _first_count(record: dict[str, Any], keys: Sequence[str]) -> int | None:
    for key in keys:
        value = record.get(key)
        if isinstance(value, int | float) and not isinstance(value, bool) and value >= 0:
            return int(value)
    return None
