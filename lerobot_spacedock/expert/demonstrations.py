"""Reads states and commands of a LeRobotDataset straight from its Parquet files; its images are not touched."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.columns import iterate_columns
from lerobot_spacedock.episode_log import MAX_STATES
from lerobot_spacedock.errors import FileFormatError, InputError, reading
from lerobot_spacedock.files import read_object
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port, get_port
from lerobot_spacedock.physics.frames import ACTION_DIM, MASS, OBSERVATION_INDICES, STATE_DIM

_INDICES = ("episode_index", "frame_index")
_COLUMNS = ("observation.state", "action", *_INDICES)


def find_dataset(name: str) -> Path:
    """The folder of a dataset given as a folder, or as a repo id in LeRobot's cache.

    Raises:
        InputError: neither is there.
    """
    cache = Path(os.environ.get("HF_HOME", Path.home() / ".cache" / "huggingface"))
    home = Path(os.environ.get("HF_LEROBOT_HOME", cache / "lerobot"))
    for folder in (Path(name).expanduser(), home / name):
        if (folder / "meta" / "info.json").is_file():
            return folder
    raise InputError(
        "init_from",
        name,
        "a checkpoint of another training (a folder with training.safetensors), a dataset's folder (with "
        f"meta/info.json), or the repo id of one under {home}",
        "A training writes OUTPUT_DIR/checkpoints/NUMBER: run that one first (spacedock train-expert)."
        if Path(name).parent.name == "checkpoints"
        else "Make a dataset with: spacedock demos",
    )


def port_of_dataset(folder: Path) -> Port:
    """Where its episodes dock, by ``meta/spacedock.json``; Zvezda's aft port where that does not say.

    Raises:
        FileFormatError, InputError: the file is damaged, or names another port.
    """
    env = _fact(folder, "env")
    return get_port(env["port"]) if "port" in env else ZVEZDA_AFT


def teacher_counts(folder: Path) -> dict[str, int]:
    """Episodes and interactions that trained whoever flew it, by ``meta/spacedock.json``; 0 where that does not say.

    Raises:
        FileFormatError: the file is damaged.
    """
    with reading(folder / "meta" / "spacedock.json", "an account of how a dataset was made"):
        training = _fact(folder, "expert").get("training") or {}
        return {name: int(training.get(name, 0)) for name in ("episodes", "interactions")}


def _fact(folder: Path, name: str) -> dict[str, Any]:
    facts = folder / "meta" / "spacedock.json"
    found = read_object(facts).get(name) if facts.is_file() else None
    return found if isinstance(found, dict) else {}


def load_demonstrations(folder: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every episode as observations (K, 13) in dataset units and commands (K, 6) in N and N·m.

    Raises:
        FileFormatError: columns missing, of another size, or not finite.
    """
    codebase = read_object(folder / "meta" / "info.json").get("codebase_version")
    if codebase != "v3.0":
        raise FileFormatError(f"{folder}: a LeRobotDataset of version {codebase}, v3.0 was expected; convert it first")
    with reading(folder / "data", f"demonstrations ({', '.join(_COLUMNS)})"):
        return _episodes(folder)


def _episodes(folder: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    columns, lengths = _columns(folder)
    state, action = columns["observation.state"], columns["action"]
    if state.shape[1] == STATE_DIM:
        state = np.delete(state, MASS, axis=1)
    if state.shape[1] != len(OBSERVATION_INDICES) or action.shape[1] != ACTION_DIM:
        raise FileFormatError(
            f"{folder}: observation.state of {state.shape[1]} and action of {action.shape[1]} values; the expert needs "
            f"{len(OBSERVATION_INDICES)} (or {STATE_DIM} with mass) and {ACTION_DIM}"
        )
    if not (np.isfinite(state).all() and np.isfinite(action).all()):
        raise FileFormatError(f"{folder}: values that are not finite")
    order = np.lexsort((columns["frame_index"][:, 0], columns["episode_index"][:, 0]))
    cuts = np.cumsum([lengths[episode] for episode in sorted(lengths)])[:-1]
    return list(zip(np.split(state[order], cuts), np.split(action[order], cuts), strict=True))


def _columns(folder: Path) -> tuple[dict[str, np.ndarray], Counter[int]]:
    """The columns, vectors in single precision; and the number of rows of each episode."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in _COLUMNS}
    lengths: Counter[int] = Counter()
    for batch in iterate_columns(folder, _COLUMNS):
        for name, values in batch.items():
            parts[name].append(values.astype(np.int64 if name in _INDICES else np.float32))
        found, counts = np.unique(parts["episode_index"][-1], return_counts=True)
        lengths.update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
        episode, rows = lengths.most_common(1)[0]
        if rows > MAX_STATES:
            raise FileFormatError(f"{folder / 'data'}: episode {episode} has more than {MAX_STATES:,} rows")
    if not lengths:
        raise FileFormatError(f"{folder / 'data'}: no rows")
    return {name: np.concatenate(parts.pop(name)) for name in _COLUMNS}, lengths
