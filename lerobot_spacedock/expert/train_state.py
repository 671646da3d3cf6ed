"""A training on disk, whole: networks, optimiser, random state, counters. A folder per checkpoint, renamed into place.

``OUT/checkpoints/000125/`` holds ``policy.safetensors`` + ``policy.json`` (what flies) and ``training.safetensors`` +
``training.json`` (what resumes). Tensors in safetensors, the rest in JSON: nothing is unpickled.
"""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save
from torch import Tensor

from lerobot_spacedock.errors import FileFormatError, InputError, reading
from lerobot_spacedock.expert.checkpoint import save_actor
from lerobot_spacedock.expert.network import ActorNetwork, NetworkConfig
from lerobot_spacedock.expert.rsl import PPO
from lerobot_spacedock.expert.train_config import TrainExpertConfig
from lerobot_spacedock.files import read_object, write_json

STATE_VERSION = 1
TRAINING_FILE = "training.safetensors"
KEPT_CHECKPOINTS = 2


def export_actor(config: TrainExpertConfig, algorithm: PPO) -> ActorNetwork:
    """The trained actor, free of rsl_rl."""
    actor = config.actor
    network = ActorNetwork(
        NetworkConfig(
            lstm_size=actor.lstm_size,
            hidden_sizes=tuple(actor.hidden_sizes),
            thrust_scale_N=actor.thrust_scale_N,
            torque_scale_Nm=actor.torque_scale_Nm,
            thrust_limit_N=actor.thrust_limit_N,
            torque_limit_Nm=actor.torque_limit_Nm,
        )
    )
    network.load_rsl_rl({k: v.detach().cpu() for k, v in algorithm.actor.state_dict().items()})
    return network.eval()


def save_checkpoint(
    folder: Path, config: TrainExpertConfig, algorithm: PPO, progress: dict[str, Any], resolved: dict[str, Any]
) -> Path:
    """Writes checkpoint ``progress["iteration"]`` under ``folder`` and removes all but the newest few."""
    target = folder / f"{progress['iteration']:06d}"
    aside = folder / f".{target.name}.part"
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir(parents=True)
    save_actor(
        aside / "policy.safetensors", export_actor(config, algorithm), {"config": resolved, **account_of(progress)}
    )
    (aside / TRAINING_FILE).write_bytes(save(_tensors(algorithm)))
    write_json(
        aside / "training.json",
        {
            "version": STATE_VERSION,
            "config": resolved,
            "progress": progress,
            "learning_rate": algorithm.learning_rate,
        },
        indent=2,
        sort_keys=True,
    )
    shutil.rmtree(target, ignore_errors=True)
    os.replace(aside, target)
    for old in checkpoints(folder)[:-KEPT_CHECKPOINTS]:
        shutil.rmtree(old)
    return target


def account_of(progress: dict[str, Any]) -> dict[str, Any]:
    """What a training cost, for its record: ``episodes`` and ``interactions`` with those that came before it."""
    account = {name: value for name, value in progress.items() if name != "curve"}
    for name in ("episodes", "interactions"):
        account[name] += account.get(f"earlier_{name}", 0)
    return account


def checkpoints(folder: Path) -> list[Path]:
    """Whole checkpoints under ``folder``, oldest first."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_dir() and path.name.isdigit())


def load_checkpoint(folder: Path, algorithm: PPO, resolved: dict[str, Any]) -> dict[str, Any]:
    """Restores the newest checkpoint into ``algorithm``; returns its progress.

    Raises:
        FileFormatError: none there, another version, another configuration, or files that do not fit.
    """
    found = checkpoints(folder)
    if not found:
        raise FileFormatError(f"{folder}: no checkpoint to resume from; start without --resume=true")
    path = found[-1]
    state = read_object(path / "training.json")
    if state.get("version") != STATE_VERSION:
        raise FileFormatError(f"{path}: training state of version {state.get('version')}, this is {STATE_VERSION}")
    with reading(path / "training.json", "the state of a training"):
        refuse_other_config(path, state["config"], resolved)
        _check_progress(path, state["progress"] | {"learning_rate": state["learning_rate"]})
    tensors = _read_tensors(path)
    with reading(path / TRAINING_FILE, "a training of this configuration"):
        for name, model in (("actor", algorithm.actor), ("critic", algorithm.critic)):
            model.load_state_dict(_part(tensors, name))
        _load_optimizer(algorithm.optimizer, _part(tensors, "optimizer"))
        torch.set_rng_state(tensors["random.cpu"])
        if "random.cuda" in tensors and torch.cuda.is_available():
            torch.cuda.set_rng_state(tensors["random.cuda"], algorithm.device)
    algorithm.learning_rate = state["learning_rate"]
    for group in algorithm.optimizer.param_groups:
        group["lr"] = state["learning_rate"]
    return state["progress"]


def _read_tensors(path: Path) -> dict[str, Tensor]:
    """``training.safetensors`` of a checkpoint folder."""
    file = path / TRAINING_FILE
    if not file.is_file():
        raise FileFormatError(f"{file}: missing; it belongs to the checkpoint")
    with reading(file, "a safetensors file"):
        return load_file(file)


def _check_progress(path: Path, progress: dict[str, Any]) -> None:
    """Raises FileFormatError unless all but the learning curve are counts, times, prices."""
    for name, value in progress.items():
        number = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf
        if not (isinstance(value, list) if name == "curve" else number):
            raise FileFormatError(f"{path / 'training.json'}: {name} is {value!r:.80}")


def load_networks(config: TrainExpertConfig, algorithm: PPO) -> dict[str, int]:
    """Copies actor and critic of the checkpoint folder ``config.init_from``: the start of another training.

    Returns:
        ``earlier_episodes`` and ``earlier_interactions``: what those networks had cost.

    Raises:
        FileFormatError: files that cannot be read or do not fit.
        InputError: one unit of the networks' output is another command here.
    """
    path = Path(config.init_from).expanduser()
    tensors = _read_tensors(path)
    with reading(path / TRAINING_FILE, "networks of the configured shape"):
        for name, model in (("actor", algorithm.actor), ("critic", algorithm.critic)):
            model.load_state_dict(_part(tensors, name))
    state = read_object(path / "training.json")
    with reading(path / "training.json", "the state of a training"):
        account = account_of(state["progress"])
        scales = {name: state["config"]["actor"][name] for name in ("thrust_scale_N", "torque_scale_Nm")}
        earlier = {f"earlier_{name}": int(account[name]) for name in ("episodes", "interactions")}
    for name, scale in scales.items():
        if getattr(config.actor, name) != scale:
            raise InputError(f"--actor.{name}", getattr(config.actor, name), f"{scale:g}, that of --init_from")
    return earlier


def refuse_other_config(path: Path, saved: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Raises FileFormatError where a training goes on with other options than ``path`` holds, but free ones."""
    free = {"resume", "output_dir", "threads", "device", "stop_after", "checkpoint_every"}
    changed = sorted(name for name in saved.keys() | wanted.keys() if saved.get(name) != wanted.get(name))
    changed = [name for name in changed if name not in free]
    if changed:
        text = ", ".join(f"{name}: {saved.get(name)!r} → {wanted.get(name)!r}" for name in changed)
        raise FileFormatError(f"{path}: made with another configuration ({text}); resume with the same one")


def _tensors(algorithm: PPO) -> dict[str, Tensor]:
    tensors = {f"actor.{k}": v for k, v in algorithm.actor.state_dict().items()}
    tensors |= {f"critic.{k}": v for k, v in algorithm.critic.state_dict().items()}
    for index, state in algorithm.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{k}": torch.as_tensor(v) for k, v in state.items()}
    tensors["random.cpu"] = torch.get_rng_state()
    if torch.device(algorithm.device).type == "cuda":
        tensors["random.cuda"] = torch.cuda.get_rng_state(algorithm.device)
    return {k: v.detach().cpu().contiguous() for k, v in tensors.items()}


def _part(tensors: dict[str, Tensor], name: str) -> dict[str, Tensor]:
    prefix = f"{name}."
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def _load_optimizer(optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    whole = optimizer.state_dict()
    whole["state"] = {}
    for name, value in tensors.items():
        index, key = name.split(".", 1)
        whole["state"].setdefault(int(index), {})[key] = value
    optimizer.load_state_dict(whole)
