"""Reads states and commands of a LeRobotDataset straight from its Parquet files; its images are not touched."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.expert.checkpoint import read_json
from lerobot_spacedock.physics.frames import ACTION_DIM, MASS, OBSERVATION_INDICES, STATE_DIM

_COLUMNS = ["observation.state", "action", "episode_index", "frame_index"]


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
        "Make a dataset with: spacedock demos",
    )


def load_demonstrations(folder: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every episode as observations (K, 13) in dataset units and commands (K, 6) in N and N·m.

    Raises:
        FileFormatError: columns missing, of another size, or not finite.
    """
    codebase = read_json(folder / "meta" / "info.json").get("codebase_version")
    if codebase != "v3.0":
        raise FileFormatError(f"{folder}: a LeRobotDataset of version {codebase}, v3.0 was expected; convert it first")
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise FileFormatError(f"{folder / 'data'}: no Parquet file")
    try:
        table = pa.concat_tables([pq.read_table(file, columns=_COLUMNS) for file in files])
    except (OSError, pa.ArrowException) as error:
        raise FileFormatError(f"{folder / 'data'}: cannot read {', '.join(_COLUMNS)} ({error})") from error
    state = np.stack(table["observation.state"].to_numpy())
    action = np.stack(table["action"].to_numpy())
    if state.shape[1] == STATE_DIM:
        state = np.delete(state, MASS, axis=1)
    if state.shape[1] != len(OBSERVATION_INDICES) or action.shape[1] != ACTION_DIM:
        raise FileFormatError(
            f"{folder}: observation.state of {state.shape[1]} and action of {action.shape[1]} values; the expert needs "
            f"{len(OBSERVATION_INDICES)} (or {STATE_DIM} with mass) and {ACTION_DIM}"
        )
    if not (np.isfinite(state).all() and np.isfinite(action).all()):
        raise FileFormatError(f"{folder}: values that are not finite")
    episode, frame = table["episode_index"].to_numpy(), table["frame_index"].to_numpy()
    order = np.lexsort((frame, episode))
    starts = np.flatnonzero(np.diff(episode[order], prepend=episode[order][0] - 1))
    return list(
        zip(
            np.split(state[order].astype(np.float32), starts[1:]),
            np.split(action[order].astype(np.float32), starts[1:]),
            strict=True,
        )
    )
