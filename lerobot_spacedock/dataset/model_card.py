"""Cards of trained policies: their configuration, their training, and their measured results."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset.card import CITATION
from lerobot_spacedock.episode_log import EpisodeLog, iterate_episode_logs
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.physics.frames import POSITION

_SHOWN_POLICY = ("chunk_size", "n_action_steps", "temporal_ensemble_coeff", "dim_model", "dropout", "vision_backbone")
_SHOWN_TRAINING = ("steps", "batch_size", "seed")


def write_model_card(
    folder: Path, repo_id: str, log_dir: str | None, *, license_id: str, tags: tuple[str, ...] = ()
) -> Path:
    """Writes ``README.md`` beside a policy.

    Args:
        folder: its ``pretrained_model``.
        repo_id: user/name.
        log_dir: episode logs of its evaluation; results are only on the card where there are logs.
        license_id: by the hub's short name.
        tags: of the card.
    """
    import yaml

    policy = _read(folder / "config.json")
    training = _read(folder / "train_config.json") if (folder / "train_config.json").exists() else {}
    data = (training.get("dataset") or {}).get("repo_id")
    header: dict[str, Any] = {
        "license": license_id,
        "library_name": "lerobot",
        "pipeline_tag": "robotics",
        "tags": ["lerobot", "robotics", "spacecraft", "docking", str(policy.get("type")), *tags],
    }
    if data:
        header["datasets"] = [data]
    parts = [
        f"---\n{yaml.safe_dump(header, sort_keys=False).strip()}\n---",
        f"# {repo_id.partition('/')[2]}\n\nA `{policy.get('type')}` policy that docks a spacecraft with the "
        "International Space Station from camera images and relative state.",
        f"## Results\n\n{_results(log_dir)}",
        f"## Training\n\n{_training(policy, training)}",
        "## Use\n\n```\npip install lerobot_env_spacedock\n"
        f"lerobot-eval --policy.path={repo_id} --env.type=spacedock\n```",
        "## Known limitations\n\nTrained and measured in simulation only; see the dataset's card for what it has seen.",
        f"## Citation\n\n```bibtex\n{CITATION}\n```",
    ]
    path = folder / "README.md"
    path.write_text("\n\n".join(parts) + "\n")
    return path


def _results(log_dir: str | None) -> str:
    if log_dir is None:
        return "Not measured: pushed without `--log_dir`."
    rows: dict[tuple[str, str], list[EpisodeLog]] = {}
    for _, log in iterate_episode_logs(log_dir):
        key = (str(log.metadata.get("env_id")), str(log.metadata.get("initial_conditions")))
        rows.setdefault(key, []).append(log)
    if not rows:
        raise InputError("--log_dir", log_dir, "a folder of episode logs (episode_*.parquet)")
    lines = [
        "| environment | starts | episodes | docked | distance at the end, mean (m) | worst (m) | outcomes |",
        "|---|---|---|---|---|---|---|",
    ]
    for (env_id, starts), logs in sorted(rows.items()):
        distance = [float(np.linalg.norm(log.state[-1, POSITION])) for log in logs]
        docked = sum(bool(log.metadata.get("success")) for log in logs)
        outcomes = ", ".join(f"{n} {k}" for k, n in Counter(log.metadata.get("outcome") for log in logs).most_common())
        lines.append(
            f"| {env_id} | {starts} | {len(logs)} | {docked} ({docked / len(logs):.0%}) | {np.mean(distance):.3f} | "
            f"{np.max(distance):.3f} | {outcomes} |"
        )
    return "\n".join(lines)


def _training(policy: dict[str, Any], training: dict[str, Any]) -> str:
    lines = [f"- {name}: {policy[name]}" for name in _SHOWN_POLICY if name in policy]
    lines += [f"- {name}: {training[name]}" for name in _SHOWN_TRAINING if name in training]
    data = training.get("dataset") or {}
    if data.get("repo_id"):
        lines.append(f"- dataset: {data['repo_id']}")
    shapes = {name: feature.get("shape") for name, feature in (policy.get("input_features") or {}).items()}
    lines.append(f"- inputs: {', '.join(f'{name} {shape}' for name, shape in shapes.items())}")
    return "\n".join(lines)


def _read(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text())
    except ValueError as error:
        raise FileFormatError(f"{path}: not JSON ({error}).") from error
