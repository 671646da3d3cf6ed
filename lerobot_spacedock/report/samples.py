"""How much a method saw: read from what its makers wrote down, never guessed.

An evaluation under LeRobot leaves ``policy.json`` beside its logs: what flew, what trained it, the dataset that it
imitates and what trained the expert in there. ``--training`` and ``--demos`` say it for logs by other makers, and go
before it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.files import read_object
from lerobot_spacedock.report.model import Samples
from lerobot_spacedock.report.runs import split_pairs

EPISODE_KEYS = ("episodes", "training_episodes", "num_episodes")
DEMONSTRATION_KEYS = ("demonstrations", "demonstration_interactions", "flown_episodes")
INTERACTION_KEYS = ("interactions", "training_interactions", "env_steps")


def read_samples(
    training: Sequence[str], demos: Sequence[str], records: Mapping[str, Sequence[Path]]
) -> dict[str, Samples]:
    """Counts by run label, for the runs of which anything is known.

    Args:
        training: ``label=file.json`` words.
        demos: ``label=root`` words.
        records: per run label, where its ``policy.json`` may lie, one a training seed; the first that is there counts.

    Raises:
        InputError: a label that is no run's, or a file that does not exist.
        FileFormatError: a file without the counts.
    """
    trained = split_pairs("--training", training, "training.json")
    shown = split_pairs("--demos", demos, "datasets/demos")
    for option, pairs in (("--training", trained), ("--demos", shown)):
        for label in pairs:
            if label not in records:
                raise InputError(option, label, " | ".join(records), "A label of --runs is meant.")
    samples = {}
    for label, paths in records.items():
        counts = next((_recorded(path) for path in paths if path.is_file()), {})
        if label in shown:
            counts |= _demonstrations(Path(shown[label]).expanduser())
        if label in trained:
            counts |= _training(Path(trained[label]).expanduser())
        if counts:
            samples[label] = Samples(**counts)
    return samples


def _recorded(path: Path) -> dict[str, Any]:
    """The counts of an evaluation's ``policy.json``; what it does not state stays out."""
    record = _json("policy.json", path)
    shown = record.get("learnt_from")
    shown = shown if isinstance(shown, dict) else {}
    training = shown.get("training") if shown else record.get("training")
    training = training if isinstance(training, dict) else {}
    counts = {
        "training_episodes": _first_count(training, EPISODE_KEYS),
        "training_interactions": _first_count(training, INTERACTION_KEYS),
        **{name: _first_count(shown, (name,)) for name in DEMONSTRATION_KEYS},
    }
    expert = shown.get("expert")
    known = {name: count for name, count in counts.items() if count is not None}
    if str(record.get("type")).startswith("spacedock_"):  # an expert: it imitates nothing
        known |= {"demonstrations": 0, "demonstration_interactions": 0}
    return known | ({"expert": expert} if isinstance(expert, str) else {})


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
        facts = _json("--demos", made)
        selection, expert = facts.get("selection"), facts.get("expert")
        counts["flown_episodes"] = _first_count(selection if isinstance(selection, dict) else {}, ("flown",))
        training = expert.get("training") if isinstance(expert, dict) else None
        if isinstance(training, dict):
            counts["training_episodes"] = _first_count(training, EPISODE_KEYS)
            counts["training_interactions"] = _first_count(training, INTERACTION_KEYS)
    return counts


def _json(option: str, path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(option, str(path), "a file that exists")
    return read_object(path)


def _first_count(record: dict[str, Any], keys: Sequence[str]) -> int | None:
    for key in keys:
        value = record.get(key)
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf:
            return int(value)
    return None
