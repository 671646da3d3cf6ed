"""Reads states and commands of a LeRobotDataset straight from its Parquet files; its images are not touched."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.errors import FileFormatError, InputError, check_size, reading
from lerobot_spacedock.files import read_object
from lerobot_spacedock.physics.frames import ACTION_DIM, MASS, OBSERVATION_INDICES, STATE_DIM

_COLUMNS = ["observation.state", "action", "episode_index", "frame_index"]
_ROW_BYTES = 1000  # a row's two vectors as NumPy objects, in arrays, and in order


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
    codebase = read_object(folder / "meta" / "info.json").get("codebase_version")
    if codebase != "v3.0":
        raise FileFormatError(f"{folder}: a LeRobotDataset of version {codebase}, v3.0 was expected; convert it first")
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise FileFormatError(f"{folder / 'data'}: no Parquet file")
    with reading(folder / "data", f"demonstrations ({', '.join(_COLUMNS)})"):
        return _episodes(folder, files)


def _episodes(folder: Path, files: list[Path]) -> list[tuple[np.ndarray, np.ndarray]]:
    for file in files:
        check_size(file, "rows", pq.read_metadata(file).num_rows * _ROW_BYTES)
    table = pa.concat_tables([pq.read_table(file, columns=_COLUMNS, partitioning=None) for file in files])
    if not table.num_rows:
        raise FileFormatError(f"{folder / 'data'}: no rows")
    state = np.stack(table["observation.state"].to_numpy())
    action = np.stack(table["action"].to_numpy())
    if state.ndim != 2 or action.ndim != 2:
        raise FileFormatError(f"{folder}: observation.state or action of one number a row; vectors are needed")
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
