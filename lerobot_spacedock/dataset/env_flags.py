"""The environment that fits a dataset or a policy, as flags of LeRobot's commands."""

from __future__ import annotations

import json
from typing import Any

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.errors import InputError


def cameras_of(features: dict[str, dict[str, Any]]) -> list[str]:
    """The names of pictures among LeRobot's features."""
    return [name for name, feature in features.items() if len(feature["shape"]) == 3]


def env_flags(features: dict[str, dict[str, Any]], env_id: str | None) -> list[str]:
    """The flags of LeRobot's commands for an environment that shows a policy what these features hold.

    Args:
        features: LeRobot's, of a dataset or of a policy's inputs; picture shapes with the channels first or last.
        env_id: of the task that it was made in or for, where that is known.
    """
    cameras = cameras_of(features)
    observed = _observed(features)
    lines = [f"--env.type=spacedock --env.task={env_id or 'SpaceDock-v0'}"]
    if cameras:
        height, width = (size for size in features[cameras[0]]["shape"] if size != 3)
        lines.append(f"--env.camera.height={height} --env.camera.width={width}")
    if observed is None:
        lines.append("--env.obs_type=pixels")
    elif not cameras:
        lines.append("--env.obs_type=agent_pos")
    if observed is not None and "mass" in observed:
        lines.append("--env.with_mass=true")
    withheld = observed is not None and "x" not in observed
    if observed is not None and withheld != (env_id == "SpaceDockVision-v0"):
        lines.append(f"--env.withhold_pose={str(withheld).lower()}")
    if cameras and schema.IMAGE not in cameras:
        lines.append(f"--rename_map='{json.dumps({schema.IMAGE: cameras[0]})}'")
    return lines


def dataset_env_flags(reader: DatasetReader) -> list[str]:
    """The same for a dataset, in the task that it was made in."""
    return env_flags(reader.features, (reader.facts.get("env") or {}).get("env_id"))


def _observed(features: dict[str, dict[str, Any]]) -> tuple[str, ...] | None:
    try:
        return schema.observed_names(*features[schema.STATE]["shape"])
    except (KeyError, InputError):  # no state, or none of this task's
        return None
