"""Episodes as arrays in one file each: ACT-style HDF5, and the same in NumPy archives.

HDF5, as the ACT code writes it: ``/action`` (K, 6), ``/observations/qpos`` (K, 13 or 14),
``/observations/images/<camera>`` (K, H, W, 3) uint8, or (K, L) where each row is a JPEG or PNG file. NumPy: ``action``,
``state``, and optionally ``images``. Both may hold ``time`` (K,) or ``dt`` (K,), in s; without either every step has
the length that the user gave. There is no state after the last one: it becomes the terminal state.

Nothing is ever unpickled: an archive of Python objects, or an HDF5 dataset of them, is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset.sources import FURTHER, NO_MASS, NO_REWARDS, EpisodeRef, LoadedEpisode, no_times
from lerobot_spacedock.dataset.sources.pictures import decode_picture
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError, MissingDependencyError, check_size, reading
from lerobot_spacedock.physics.constants import CHASER_MASS_kg
from lerobot_spacedock.physics.frames import ACTION_DIM, MASS, OBSERVATION_INDICES, STATE_DIM

_EPISODE = re.compile(r"episode_(\d+)\.(hdf5|npz)")


_KINDS = {"hdf5": "an HDF5 file", "npz": "a NumPy archive"}


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    found = [(int(m[1]), m[2], file) for file in path.iterdir() if (m := _EPISODE.fullmatch(file.name))]
    return [EpisodeRef(kind, str(file), options=options) for _, kind, file in sorted(found, key=lambda f: (f[0], f[1]))]


def load(ref: EpisodeRef) -> LoadedEpisode:
    file = Path(ref.path)
    with reading(file, _KINDS[ref.format]):
        arrays = _read_hdf5(file) if ref.format == "hdf5" else _read_npz(file)
    log = log_of_arrays(
        str(file),
        state=arrays["state"],
        action=arrays["action"],
        time=arrays.get("time"),
        dt=arrays.get("dt"),
        reward=arrays.get("reward"),
        step_s=float(ref.option("step_s") or 0.907),
        metadata={"source": ref.format, "success": arrays.get("success")} | arrays.get("left_out", {}),
    )
    if "images" not in arrays:
        return LoadedEpisode(log)
    count = arrays["images"]
    if count < log.num_steps:
        raise FileFormatError(f"{file}: {count} pictures for {log.num_steps} steps.")

    def frames(first: int) -> Iterator[np.ndarray]:
        read = _hdf5_frames if ref.format == "hdf5" else _npz_frames
        with reading(file, _KINDS[ref.format]):
            yield from read(file, first, log.num_steps)

    return LoadedEpisode(log, frames)


def log_of_arrays(
    place: str,
    *,
    state: np.ndarray,
    action: np.ndarray,
    time: np.ndarray | None = None,
    dt: np.ndarray | None = None,
    reward: np.ndarray | None = None,
    step_s: float,
    metadata: dict[str, Any],
) -> EpisodeLog:
    """An episode log out of arrays of other origin.

    Args:
        place: for error messages.
        state: (n, 13) or (n, 14), dataset order and units.
        action: N and N·m, (n, 6) or (n - 1, 6).
        time: s, (n,); wins over ``dt``.
        dt: s, at least (n - 1,).
        reward: at least (n - 1,).
        step_s: s, where neither time nor dt is given.
        metadata: of the log.
    """
    state = _matrix(place, "state", state)
    action = _matrix(place, "action", action)
    rows, width = state.shape
    if width not in (STATE_DIM - 1, STATE_DIM):
        raise FileFormatError(f"{place}: the state has {width} values; 13 (or 14, with the mass) are needed.")
    if action.shape[1] != ACTION_DIM or len(action) not in (rows, rows - 1):
        raise FileFormatError(f"{place}: action has shape {action.shape}; ({rows}, {ACTION_DIM}) is needed.")
    if rows < 3:
        raise FileFormatError(f"{place}: {rows} rows; an episode has at least 3.")
    if width == STATE_DIM - 1:
        full = np.empty((rows, STATE_DIM))
        full[:, OBSERVATION_INDICES] = state
        full[:, MASS] = CHASER_MASS_kg
        state, metadata = full, metadata | {"mass": NO_MASS}
    if time is not None:
        time = _vector(place, "time", time, rows)
        dt = np.diff(time)
    elif dt is not None:
        dt = _vector(place, "dt", dt, rows - 1)
    else:
        dt, metadata = np.full(rows - 1, step_s), metadata | {"times": no_times(step_s)}
    bad = np.flatnonzero(~(dt > 0.0))
    if bad.size:
        raise FileFormatError(f"{place}: row {bad[0]}: a step of {dt[bad[0]]} s; times have to increase.")
    if reward is None:
        metadata = metadata | {"rewards": NO_REWARDS}
    return EpisodeLog(
        time=np.concatenate([[0.0], np.cumsum(dt)]),
        state=state,
        action=action[: rows - 1],
        dt=dt,
        reward=np.zeros(rows - 1) if reward is None else _vector(place, "reward", reward, rows - 1),
        metadata=metadata,
    )


def _read_hdf5(file: Path) -> dict[str, Any]:
    with _open_hdf5(file) as content:
        arrays: dict[str, Any] = {
            "state": _numbers(file, content, "observations/qpos"),
            "action": _numbers(file, content, "action"),
        }
        for name in ("time", "dt", "reward"):
            for path in (name, f"observations/{name}"):
                if path in content:
                    arrays[name] = _numbers(file, content, path)
        if "success" in content.attrs:
            arrays["success"] = bool(content.attrs["success"])
        images = content.get("observations/images")
        if images is not None:
            shown = _camera(file, images)
            arrays["images"] = len(shown)
            if others := [name for name in sorted(images) if images[name] != shown]:
                arrays["left_out"] = {FURTHER: f"of the source left out: images/{', images/'.join(others)}"}
        return arrays


def _hdf5_frames(file: Path, first: int, last: int) -> Iterator[np.ndarray]:
    with _open_hdf5(file) as content:
        pictures = _camera(file, content["observations/images"])
        for row in range(first, last):
            yield _picture(f"{file}, {pictures.name}, row {row}", pictures[row])


def _open_hdf5(file: Path) -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MissingDependencyError("h5py is needed: pip install '.[hdf5]' in SpaceDock's folder") from error
    try:
        return h5py.File(file, "r")
    except OSError as error:
        raise FileFormatError(f"{file}: not a readable HDF5 file ({error}).") from error


def _camera(file: Path, images: Any) -> Any:
    """The only camera, or the one called ``camera``; its dtype is checked, its pictures are not read yet."""
    names = sorted(images)
    name = "camera" if "camera" in names else names[0] if len(names) == 1 else None
    if name is None:
        raise FileFormatError(f"{file}: cameras {names}; one of them has to be called 'camera'.")
    if images[name].dtype != np.uint8:
        raise FileFormatError(f"{file}: {images[name].name} has dtype {images[name].dtype}; uint8 is needed.")
    check_size(file, images[name].name, int(np.prod(images[name].shape[1:], dtype=object)))
    return images[name]


def _numbers(file: Path, content: Any, name: str) -> np.ndarray:
    if name not in content:
        raise FileFormatError(f"{file}: {name!r} is missing; ACT-style episodes hold action and observations/qpos.")
    if content[name].dtype.kind not in "fiu":
        raise FileFormatError(f"{file}: {name!r} has dtype {content[name].dtype}; numbers are needed, never objects.")
    check_size(file, name, content[name].size * 8)
    return content[name][()]


def _read_npz(file: Path) -> dict[str, Any]:
    with _open_npz(file) as content:
        missing = [name for name in ("state", "action") if name not in content]
        if missing:
            raise FileFormatError(f"{file}: arrays {missing} are missing; it holds {sorted(content)}.")
        arrays = {name: _member(file, content, name) for name in sorted(content) if name != "images"}
        if "images" in content:
            arrays["images"] = len(_member(file, content, "images"))
        if "success" in arrays:
            arrays["success"] = bool(np.all(arrays["success"]))
        return arrays


def _npz_frames(file: Path, first: int, last: int) -> Iterator[np.ndarray]:
    with _open_npz(file) as content:
        pictures = _member(file, content, "images")
    for row in range(first, last):
        yield _picture(f"{file}, images, row {row}", pictures[row])


def _open_npz(file: Path) -> Any:
    try:
        content = np.load(file, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise FileFormatError(f"{file}: not a readable NumPy archive ({error}).") from error
    if isinstance(content, np.ndarray):
        raise FileFormatError(f"{file}: a single array; an archive (.npz) of state and action is needed.")
    return content


def _member(file: Path, content: Any, name: str) -> np.ndarray:
    _check_member(file, content, name)
    try:
        values = content[name]
    except ValueError as error:  # what NumPy says of pickled objects
        raise FileFormatError(f"{file}: {name!r} holds Python objects; numbers are needed, never objects.") from error
    except Exception as error:  # zipfile and zlib have errors of their own for a damaged archive
        raise FileFormatError(f"{file}: {name!r} is not readable ({error}).") from error
    if values.dtype.kind not in "fiub":
        raise FileFormatError(f"{file}: {name!r} has dtype {values.dtype}; numbers are needed.")
    return values


def _check_member(file: Path, content: Any, name: str) -> None:
    """Compares what a member's header claims with what is in the archive, before NumPy makes room for it."""
    info = content.zip.getinfo(name if name in content.zip.namelist() else f"{name}.npy")
    with content.zip.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    claimed = int(np.prod(shape, dtype=object)) * dtype.itemsize
    check_size(file, name, claimed)
    if not dtype.hasobject and claimed > info.file_size:
        raise FileFormatError(f"{file}: {name!r} claims {claimed:,} bytes and holds {info.file_size:,}.")


def _picture(place: str, row: np.ndarray) -> np.ndarray:
    if row.dtype != np.uint8:
        raise FileFormatError(f"{place}: dtype {row.dtype}; uint8 is needed.")
    if row.ndim == 3 and row.shape[-1] == 3:
        return row
    if row.ndim != 1:
        raise FileFormatError(f"{place}: shape {row.shape}; (height, width, 3) or an encoded picture is needed.")
    return decode_picture(row.tobytes(), place)


def _matrix(place: str, name: str, values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 2:
        raise FileFormatError(f"{place}: {name} has shape {values.shape}; two dimensions are needed.")
    return _finite(place, name, values)


def _vector(place: str, name: str, values: np.ndarray, length: int) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64).reshape(-1)
    if len(values) < length:
        raise FileFormatError(f"{place}: {name} has {len(values)} values; {length} are needed.")
    return _finite(place, name, values[:length])


def _finite(place: str, name: str, values: np.ndarray) -> np.ndarray:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise FileFormatError(f"{place}: {name}, row {bad[0][0]}: {values[tuple(bad[0])]} is not finite.")
    return values
