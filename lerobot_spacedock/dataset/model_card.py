"""Cards of trained policies: their configuration, their training, and their measured results."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset.card import CITATION, write_own
from lerobot_spacedock.dataset.env_flags import cameras_of, env_flags
from lerobot_spacedock.episode_log import POLICY_FILE, SURPLUS_FOLDER
from lerobot_spacedock.errors import InputError, reading
from lerobot_spacedock.files import read_object
from lerobot_spacedock.metrics.collect import measured
from lerobot_spacedock.metrics.statistics import clopper_pearson

_SHOWN_POLICY = ("chunk_size", "n_action_steps", "temporal_ensemble_coeff", "dim_model", "dropout", "vision_backbone")
_SHOWN_TRAINING = ("steps", "batch_size", "seed")


def write_model_card(
    folder: Path, repo_id: str, log_dir: str | None, *, license_id: str, tags: tuple[str, ...] = ()
) -> Path:
    """Writes ``README.md`` beside a policy.

    Args:
        folder: its ``pretrained_model``.
        repo_id: user/name.
        log_dir: episode logs of its evaluation, in the folder or in folders below it, a task or a set of starts each;
            results are only on the card where there are logs.
        license_id: by the hub's short name.
        tags: of the card.

    Raises:
        InputError: there is no log in ``log_dir``.
        FileFormatError: what the policy says of itself, or a log, cannot be used.
    """
    with reading(folder, "a policy"):
        text = _card(folder, repo_id, log_dir, license_id, tags)
    path = folder / "README.md"
    write_own(path, text)
    return path


def evaluation_command(folder: Path, repo_id: str, env: dict[str, Any] | None = None) -> list[str]:
    """The words of ``lerobot-eval`` that fly a policy as it was trained, from the hub.

    Args:
        folder: its ``pretrained_model``.
        repo_id: user/name.
        env: as ``env_flags`` takes it; left out, that of its training.
    """
    policy, training = _configs(folder)
    if env is None:
        env = training.get("env") or {}
        env = env | {"env_id": env.get("task")}
    return [f"lerobot-eval --policy.path={repo_id}", *env_flags(policy.get("input_features") or {}, env)]


def _configs(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a policy and its training say of themselves; the second may be nothing."""
    training = folder / "train_config.json"
    return read_object(folder / "config.json"), read_object(training) if training.exists() else {}


def _card(folder: Path, repo_id: str, log_dir: str | None, license_id: str, tags: tuple[str, ...]) -> str:
    import yaml

    policy, training = _configs(folder)
    data = (training.get("dataset") or {}).get("repo_id")
    inputs = policy.get("input_features") or {}
    header: dict[str, Any] = {
        "license": license_id,
        "library_name": "lerobot",
        "pipeline_tag": "robotics",
        "tags": ["lerobot", "robotics", "spacecraft", "docking", str(policy.get("type")), *tags],
    }
    if data:
        header["datasets"] = [data]
    env, results = _results(log_dir)
    use = " \\\n    ".join(evaluation_command(folder, repo_id, env))
    parts = [
        f"---\n{yaml.safe_dump(header, sort_keys=False).strip()}\n---",
        f"# {repo_id.partition('/')[2]}\n\nA policy of type `{policy.get('type')}`, trained to dock a "
        f"spacecraft with the International Space Station in simulation. It sees {_seen(inputs)} and commands thrust "
        "and torque (N and N·m, body axes).",
        f"## Results\n\n{results}",
        f"## Training\n\n{_training(policy, training)}",
        f"## Use\n\nWith LeRobot and its plugin `lerobot_env_spacedock` installed:\n\n```bash\n{use}\n```",
        "## Known limitations\n\nTrained and measured in simulation only; it has seen what its dataset shows, of which "
        "that dataset's card says the limits.",
        f"## Licence and citation\n\nLicence: {license_id}. The task is that of\n\n```bibtex\n{CITATION}\n```",
    ]
    return "\n\n".join(parts) + "\n"


def _seen(inputs: dict[str, Any]) -> str:
    words = [
        f"pictures of {' × '.join(str(size) for size in feature['shape'] if size != 3)} pixels"
        if name in cameras_of(inputs)
        else f"`{name}` ({feature['shape'][0]} values)"
        for name, feature in inputs.items()
    ]
    return " and ".join(words) or "nothing that its `config.json` names"


def _results(log_dir: str | None) -> tuple[dict[str, Any] | None, str]:
    """The environment in which most episodes were flown, from whatever starts; and the table."""
    if log_dir is None:
        return None, "Not measured: pushed without `--log_dir`."
    rows: dict[tuple[str, str], list[dict[str, Any]]] = {}
    flown: Counter[str] = Counter()
    for path in sorted(Path(log_dir).rglob("episode_*.parquet")):
        if path.parent.name == SURPLUS_FOLDER:
            continue
        log, metrics = measured(path)
        if log.metadata.get("surplus"):
            continue
        key = (str(log.metadata.get("env_id")), str(log.metadata.get("initial_conditions")))
        stated = {name: log.metadata.get(name) for name in ("outcome", "seed")}
        env = {"env_id": log.metadata.get("env_id")} | (log.metadata.get("config") or {})
        flown[json.dumps(env | {"initial_conditions": None}, sort_keys=True)] += 1
        rows.setdefault(key, []).append(metrics | stated)
    if not rows:
        raise InputError("--log_dir", log_dir, "a folder of episode logs (episode_*.parquet)")
    lines = [
        "| environment | starts | episodes | docked [95 %] | ‖r‖ at the end, mean / p95 (m) | ‖v‖, mean (m/s) "
        "| outcomes |",
        "|---|---|---|---|---|---|---|",
    ]
    for (env_id, starts), episodes in sorted(rows.items()):
        docked = sum(bool(episode["success"]) for episode in episodes)
        sure = clopper_pearson(docked, len(episodes))
        share = f"{docked} of {len(episodes)}, {sure.estimate:.1%} [{sure.low:.1%}, {sure.high:.1%}]"
        distance, speed = (np.array([e[f"final_{name}"] for e in episodes]) for name in ("distance_m", "speed_m_s"))
        outcomes = ", ".join(f"{n} {kind}" for kind, n in Counter(e["outcome"] for e in episodes).most_common())
        lines.append(
            f"| {env_id} | {starts} | {len(episodes)} | {share} | {distance.mean():.3f} / "
            f"{np.percentile(distance, 95):.3f} | {speed.mean():.3f} | {outcomes} |"
        )
    seeds = [episode["seed"] for episodes in rows.values() for episode in episodes if episode["seed"] is not None]
    lines += ["", "Docked: inside the IDSS box. Every episode counts; intervals are Clopper and Pearson's."]
    if seeds:
        lines.append(f"Seeds {min(seeds)} to {max(seeds)}." if len(seeds) > 1 else f"Seed {seeds[0]}.")
    commands = _evaluations(Path(log_dir))
    if commands:
        lines += ["Measured by\n\n```bash\n{}\n```".format("\n".join(commands))]
    return json.loads(flown.most_common(1)[0][0]), "\n".join(lines)


def _evaluations(log_dir: Path) -> list[str]:
    """The commands that the evaluations have left beside their logs."""
    stated = [read_object(path).get("command") for path in sorted(log_dir.rglob(POLICY_FILE))]
    return [str(command) for command in stated if command]


def _training(policy: dict[str, Any], training: dict[str, Any]) -> str:
    lines = [f"- {name}: {policy[name]}" for name in _SHOWN_POLICY if policy.get(name) is not None]
    lines += [f"- {name}: {training[name]}" for name in _SHOWN_TRAINING if name in training]
    data = training.get("dataset") or {}
    if data.get("repo_id"):
        lines.append(f"- dataset: {data['repo_id']}")
    if training:
        lines.append("- every option: `train_config.json`")
    return "\n".join(lines) or "Not recorded: no `train_config.json`."
