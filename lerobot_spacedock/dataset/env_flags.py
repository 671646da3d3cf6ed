"""The environment that fits a dataset or a policy, as flags of LeRobot's commands."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict
from typing import Any

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.job import dotted
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS, withholds_pose
from lerobot_spacedock.env.scenario_config import INITIAL_CONDITIONS
from lerobot_spacedock.errors import InputError

# what the features say (or the port, of the camera's), and what belongs to one flight alone
_SAID_ELSEWHERE = ("env_id", "obs_type", "with_mass", "withhold_pose")
_SAID_ELSEWHERE += ("camera.height", "camera.width", "camera.port", "log_dir", "label")


def cameras_of(features: dict[str, dict[str, Any]]) -> list[str]:
    """The names of pictures among LeRobot's features."""
    return [name for name, feature in features.items() if len(feature["shape"]) == 3]


def env_flags(features: dict[str, dict[str, Any]], env: dict[str, Any]) -> list[str]:
    """The flags of LeRobot's commands for an environment that shows a policy what these features hold.

    Args:
        features: LeRobot's, of a dataset or of a policy's inputs; picture shapes with the channels first or last.
        env: what is known of the environment that it was made in or for: options of ``SpaceDockConfig``, nested, of
            which some or all may be missing, None, or of other environments.
    """
    env_id = env.get("env_id") or SpaceDockConfig.env_id
    cameras = cameras_of(features)
    observed = _observed(features)
    lines = [f"--env.type=spacedock {shlex.quote(f'--env.task={env_id}')}", *_differing(env_id, env)]
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
    if observed is not None and withheld != withholds_pose(env_id):
        lines.append(f"--env.withhold_pose={str(withheld).lower()}")
    if cameras and schema.IMAGE not in cameras:
        lines.append(f"--rename_map='{json.dumps({schema.IMAGE: cameras[0]})}'")
    return lines


def dataset_env_flags(reader: DatasetReader) -> list[str]:
    """The same for a dataset, in the environment that it was made in."""
    facts = reader.facts
    # of flights that others made: what their pictures show
    env = dict(facts.get("env") or {**(facts.get("drawing") or {}), "port": facts.get("port")})
    if starts := facts.get("initial_conditions"):  # the episodes' own, where the environment is that of the first
        env["initial_conditions"] = starts[0] if len(starts) == 1 and starts[0] in INITIAL_CONDITIONS else None
    flags = env_flags(reader.features, env)
    if not facts:  # made elsewhere, or by a tool that keeps no meta/spacedock.json: nothing says in which task
        flags[0] = "--env.type=spacedock --env.task=…"
    return flags


def _differing(env_id: str, env: dict[str, Any]) -> list[str]:
    """A flag for each option that is not what the id has by default."""
    plain = SpaceDockConfig.from_options(**{"env_id": env_id} | ENV_IDS.get(env_id, {}))
    default, given = (dotted(json.loads(json.dumps(options))) for options in (asdict(plain), env))
    return [
        shlex.quote(f"--env.{name}={value if isinstance(value, str) else json.dumps(value)}")
        for name, value in given.items()
        if name in default and name not in _SAID_ELSEWHERE and value is not None and value != default[name]
    ]


def _observed(features: dict[str, dict[str, Any]]) -> tuple[str, ...] | None:
    try:
        return schema.observed_names(*features[schema.STATE]["shape"])
    except (KeyError, InputError):  # no state, or none of this task's
        return None
