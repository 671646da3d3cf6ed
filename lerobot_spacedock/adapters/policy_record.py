"""What the running LeRobot command flies, and what that learnt from: ``policy.json`` beside the episode logs.

The report's bill of interactions (its first table) is read from it: an imitator's demonstrations, and the training of
the expert that flew them, are on its account. What is written nowhere is left out, never guessed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lerobot_spacedock.adapters.command_line import command_option, dataset_folder, policy_file
from lerobot_spacedock.errors import FileFormatError
from lerobot_spacedock.files import read_object
from lerobot_spacedock.invocation import command_line

UNTRAINED = ("spacedock_mpc", "spacedock_zem", "spacedock_feedback")
LEARNT = "spacedock_meta_rl"


def policy_record() -> dict[str, Any] | None:
    """The policy's name, its type, its training, and the dataset that it imitates; None outside LeRobot's commands."""
    from lerobot_spacedock.expert.checkpoint import training_counts

    path = command_option("policy.path")
    kind = command_option("policy.type") or _of_policy("config.json").get("type")
    if path is None and kind is None:
        return None
    record: dict[str, Any] = {"policy": path or kind, "type": kind, "command": command_line()}
    if kind in UNTRAINED:
        return record | {"training": {"episodes": 0, "interactions": 0}}
    if kind == LEARNT:
        return record | {"training": None if path else training_counts("meta_rl", command_option("policy.checkpoint"))}
    # the dataset of the training that runs, or of the one that left the checkpoint
    stated = {"root": command_option("dataset.root"), "repo_id": command_option("dataset.repo_id")}
    if not any(stated.values()):
        dataset = _of_policy("train_config.json").get("dataset")
        stated = dataset if isinstance(dataset, dict) else {}
    root = dataset_folder(stated.get("root"), stated.get("repo_id"))
    return record | {"dataset": None if root is None else str(root), "learnt_from": root and _demonstrations(root)}


def _demonstrations(root: Path) -> dict[str, Any]:
    """Counts of a dataset, and of the training of the expert that flew it."""
    from lerobot_spacedock.expert.checkpoint import training_counts

    info, made = _json(root / "meta" / "info.json"), _json(root / "meta" / "spacedock.json")
    expert, selection = made.get("expert"), made.get("selection")
    record = {
        "demonstrations": info.get("total_episodes"),
        "demonstration_interactions": info.get("total_frames"),
        "flown_episodes": selection.get("flown") if isinstance(selection, dict) else None,
    }
    if isinstance(expert, dict) and isinstance(name := expert.get("name"), str):
        stated = expert.get("training")  # written by newer versions of spacedock demos
        record |= {"expert": name, "training": stated or training_counts(name, expert.get("checkpoint"))}
    return record


def _of_policy(name: str) -> dict[str, Any]:
    path = policy_file(name)
    return {} if path is None else _json(path)


def _json(path: Path) -> dict[str, Any]:
    """Empty where it is missing or damaged."""
    try:
        return read_object(path)
    except FileFormatError:
        return {}
