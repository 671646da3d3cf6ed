"""The episode log: one Parquet file an episode, one row a state. What every metric reads, whoever wrote it.

Columns ``step, time, dt, x..w3, Tx..Lz, reward``; units as in ``physics/frames.py``, rates in
**deg/s**. Row ``k`` holds the state before step ``k`` and the command, step length and reward of that
step; the last row is the terminal state, whose command, ``dt`` and ``reward`` are null. File metadata
``spacedock`` is a JSON object (``METADATA_KEYS``). Further float columns are allowed: kept in
``EpisodeLog.extra``, passed over by whoever does not know them. Where sensors err, ``observed_x`` … hold what
the policy saw; ``x`` … are always the truth.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.errors import FileFormatError
from lerobot_spacedock.files import aside
from lerobot_spacedock.physics.frames import ACTION_NAMES, OBSERVATION_NAMES, STATE_NAMES

COLUMNS = ("step", "time", "dt", *STATE_NAMES, *ACTION_NAMES, "reward")
POLICY_FILE = "policy.json"  # beside the logs of an evaluation under LeRobot: what flew
OBSERVED = "observed_"  # begins the names of what the policy saw, where that is not the truth
SURPLUS_FOLDER = "surplus"  # beside them too: episodes that only filled the last vector batch
MAX_STATES = 1_000_000  # eleven days of steps; a file that claims more is no episode
METADATA_KEYS = (
    "version",
    "env_id",
    "config",
    "seed",
    "initial_conditions",
    "label",
    "outcome",
    "success",
    "contact",
    "clipped_actions",
    "dynamics",
    "inference",
)


def observed_columns(observed: np.ndarray) -> dict[str, np.ndarray]:
    """``EpisodeLog.extra`` of what a policy saw where that is not the truth: (K, 13), dataset units → names to (K,)."""
    return {OBSERVED + name: observed[:, i].astype(np.float64) for i, name in enumerate(OBSERVATION_NAMES)}


@dataclass(frozen=True)
class EpisodeLog:
    """One episode of ``K`` steps.

    Attributes:
        time: s, (K+1,), from 0.
        state: (K+1, 14) float64, dataset order and units (rates in deg/s).
        action: N and N·m, (K, 6) float64: the commands as executed after clipping.
        dt: s, (K,).
        reward: (K,).
        metadata: see ``METADATA_KEYS``; logs of other origin may hold fewer keys.
        extra: further columns by name, each (K,), a value a step, or (K+1,), a value a state.
    """

    time: np.ndarray
    state: np.ndarray
    action: np.ndarray
    dt: np.ndarray
    reward: np.ndarray
    metadata: dict[str, Any] = field(default_factory=dict)
    extra: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def num_steps(self) -> int:
        return len(self.dt)


def log_path(log_dir: Path | str, seed: int) -> Path:
    """The file of the episode with this seed: ``episode_{seed:06d}.parquet``."""
    return Path(log_dir) / f"episode_{seed:06d}.parquet"


def write_episode_log(path: Path | str, log: EpisodeLog) -> Path:
    """Writes one episode aside and renames it, so that a killed run leaves a whole file or none.

    Returns:
        The path written. An existing file of that name is replaced.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = log.num_steps + 1
    columns: dict[str, pa.Array] = {
        "step": pa.array(np.arange(rows), pa.int32()),
        "time": pa.array(log.time, pa.float64()),
        "dt": _with_null_end(log.dt),
    }
    columns |= {name: pa.array(log.state[:, i], pa.float64()) for i, name in enumerate(STATE_NAMES)}
    columns |= {name: _with_null_end(log.action[:, i]) for i, name in enumerate(ACTION_NAMES)}
    columns["reward"] = _with_null_end(log.reward)
    for name, values in log.extra.items():
        columns[name] = pa.array(values, pa.float64()) if len(values) == rows else _with_null_end(values)
    table = pa.table(columns).replace_schema_metadata({"spacedock": json.dumps(log.metadata)})
    with aside(path, shared=True) as own:
        # for files this small: half the time to read, half to write, and smaller than Arrow's defaults
        pq.write_table(table, own, compression="snappy", use_dictionary=False, write_statistics=False)
    return path


def read_episode_log(path: Path | str) -> EpisodeLog:
    """Reads one episode log; the last row's command, dt and reward may be null or present (then ignored).

    Raises:
        FileFormatError: not Parquet, a column is missing or not numeric, too few rows or too many, or not finite.
    """
    path = Path(path)
    try:
        with pq.ParquetFile(path) as file:  # not pq.read_table: a third of its time for a file this small
            schema, rows = file.schema_arrow, file.metadata.num_rows
            _check_shape(path, schema, rows)
            extra = [f.name for f in schema if f.name not in COLUMNS and pa.types.is_floating(f.type)]
            given = [name for name in COLUMNS if name != "step" and name in schema.names]
            table = file.read(columns=given + extra, use_threads=False)
    except FileNotFoundError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(f"{path}: not a readable Parquet file ({error}).") from error
    numbers = _numbers(path, table, given + extra)
    fine = np.isfinite(numbers)
    fine[:, len(given) :] = True
    fine[-1, [i for i, name in enumerate(given) if name != "time" and name not in STATE_NAMES]] = True
    if not fine.all():
        row, column = np.argwhere(~fine)[0]
        raise FileFormatError(
            f"{path}: column {given[column]!r} holds {numbers[row, column]} in row {row}; only the last row's "
            "command, dt and reward may be empty."
        )
    columns = dict(zip(given + extra, numbers.T, strict=True))
    return EpisodeLog(
        time=columns["time"],
        state=np.stack([columns[name] for name in STATE_NAMES], axis=1),
        action=np.stack([columns[name][: rows - 1] for name in ACTION_NAMES], axis=1),
        dt=columns["dt"][: rows - 1],
        reward=columns["reward"][: rows - 1] if "reward" in columns else np.zeros(rows - 1),
        metadata=_metadata(path, schema),
        extra={name: columns[name][: rows - bool(table.column(name).slice(rows - 1).null_count)] for name in extra},
    )


def iterate_episode_logs(log_dir: Path | str) -> Iterator[tuple[Path, EpisodeLog]]:
    """Every ``episode_*.parquet`` of a folder, in name order, one at a time (flat memory)."""
    for path in sorted(Path(log_dir).glob("episode_*.parquet")):
        yield path, read_episode_log(path)


def _check_shape(path: Path, schema: pa.Schema, rows: int) -> None:
    missing = [name for name in COLUMNS if name not in schema.names and name not in ("step", "reward")]
    if missing:
        raise FileFormatError(f"{path}: columns {missing} are missing; an episode log has {list(COLUMNS)}.")
    if len(set(schema.names)) < len(schema.names):
        raise FileFormatError(f"{path}: a column twice: {schema.names}.")
    if not 1 <= rows <= MAX_STATES:
        raise FileFormatError(f"{path}: {rows} rows; an episode log has 1 to {MAX_STATES:,} states.")


def _numbers(path: Path, table: pa.Table, names: list[str]) -> np.ndarray:
    """(rows, columns) float64, NaN where null."""
    try:
        (batch,) = table.combine_chunks().to_batches()
        return batch.to_tensor(null_to_nan=True, row_major=False).to_numpy().astype(np.float64, copy=False)
    except (pa.ArrowException, TypeError, ValueError):  # a type that no tensor holds: column by column
        columns = []
        for name in names:
            try:
                columns.append(table.column(name).to_numpy().astype(np.float64))
            except (pa.ArrowException, ValueError, TypeError) as error:
                raise FileFormatError(f"{path}: column {name!r} is not numeric ({error}).") from error
        return np.stack(columns, axis=1)


def _metadata(path: Path, schema: pa.Schema) -> dict[str, Any]:
    try:
        metadata = json.loads((schema.metadata or {}).get(b"spacedock", b"{}"))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: file metadata 'spacedock' is not JSON ({error}).") from error
    if not isinstance(metadata, dict):
        raise FileFormatError(f"{path}: file metadata 'spacedock' is {type(metadata).__name__}, not a JSON object.")
    return metadata


def _with_null_end(values: np.ndarray) -> pa.Array:
    padded = np.append(np.asarray(values, dtype=np.float64), 0.0)
    return pa.array(padded, pa.float64(), mask=np.arange(len(padded)) == len(padded) - 1)
