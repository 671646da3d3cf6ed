"""Between the episode log and the rows of a dataset: the same episode, seen twice.

An episode travels through this room as an ``EpisodeLog``: ``state`` is the truth, ``action`` what flew.
Where the label differs from what flew, or the observation from the truth, the log carries both in further
columns.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.physics.frames import (
    ACTION_NAMES,
    MASS,
    OBSERVATION_INDICES,
    OBSERVATION_NAMES,
    STATE_DIM,
    STATE_NAMES,
)

LABEL_COLUMNS = tuple(f"label_{name}" for name in ACTION_NAMES)
OBSERVED_COLUMNS = tuple(f"observed_{name}" for name in OBSERVATION_NAMES)


def teaching_columns(*, label: np.ndarray, observed: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """The further log columns of a demonstration.

    Args:
        label: N and N·m, (K, 6): the clean command of the expert.
        observed: (K, 13) in dataset units: what the expert saw; None where it saw the truth.

    Returns:
        Columns for ``EpisodeLog.extra``.
    """
    extra = {name: label[:, i] for i, name in enumerate(LABEL_COLUMNS)}
    if observed is not None:
        extra |= {name: observed[:, i] for i, name in enumerate(OBSERVED_COLUMNS)}
    return extra


def label_of(log: EpisodeLog) -> np.ndarray:
    """N and N·m, (K, 6): the label, which is the executed command unless the log says otherwise."""
    if not all(name in log.extra for name in LABEL_COLUMNS):
        return log.action
    return np.stack([log.extra[name][: log.num_steps] for name in LABEL_COLUMNS], axis=1)


def observed_of(log: EpisodeLog, *, with_mass: bool = False) -> np.ndarray:
    """(K, 13) or (K, 14), dataset units: what the policy saw, which is the truth unless the log says so."""
    if all(name in log.extra for name in OBSERVED_COLUMNS):
        seen = np.stack([log.extra[name][: log.num_steps] for name in OBSERVED_COLUMNS], axis=1)
    else:
        seen = log.state[:-1, OBSERVATION_INDICES]
    return np.insert(seen, MASS, log.state[:-1, MASS], axis=1) if with_mass else seen


def succeeded(log: EpisodeLog) -> bool:
    return bool(log.metadata.get("success", False))


def rows_of(log: EpisodeLog, *, with_mass: bool = False) -> dict[str, np.ndarray]:
    """The dataset's columns, image apart, for the K frames of an episode; scalars as (K, 1)."""
    steps = log.num_steps
    last = np.arange(steps)[:, None] == steps - 1
    return {
        schema.STATE: observed_of(log, with_mass=with_mass).astype(np.float32),
        schema.ACTION: label_of(log).astype(np.float32),
        schema.CONTROL_DT: log.dt[:, None].astype(np.float32),
        schema.SIM_TIME: log.time[:-1, None].astype(np.float32),
        schema.REWARD: log.reward[:, None].astype(np.float32),
        schema.SUCCESS: last & succeeded(log),
        schema.DONE: last,
        schema.TRUE_STATE: log.state[:-1].astype(np.float32),
        schema.EXECUTED_ACTION: log.action.astype(np.float32),
    }


def log_of_rows(
    rows: dict[str, np.ndarray], *, terminal_state: np.ndarray | None = None, metadata: dict | None = None
) -> EpisodeLog:
    """The episode log of one episode's rows: the inverse of ``rows_of``, exact to float32.

    Args:
        rows: columns of one episode, as ``rows_of`` gives them; the optional ones may be missing.
        terminal_state: (14,), dataset units. Without it the last frame's state becomes the terminal one and
            its command is dropped.
        metadata: of the log.
    """
    rows = {name: np.asarray(values, dtype=np.float64) for name, values in rows.items()}
    steps = len(rows[schema.STATE])
    dt = rows[schema.CONTROL_DT].reshape(steps)
    start = rows[schema.SIM_TIME].reshape(steps)
    state = rows[schema.TRUE_STATE] if schema.TRUE_STATE in rows else _state_of_observed(rows[schema.STATE])
    action = rows.get(schema.EXECUTED_ACTION, rows[schema.ACTION])
    reward = rows[schema.REWARD].reshape(steps) if schema.REWARD in rows else np.zeros(steps)
    extra = {}
    if schema.EXECUTED_ACTION in rows and not np.array_equal(rows[schema.ACTION], action):
        extra |= teaching_columns(label=rows[schema.ACTION])
    if schema.TRUE_STATE in rows:
        seen = _drop_mass(rows[schema.STATE])
        if not np.array_equal(seen, state[:, OBSERVATION_INDICES]):
            extra |= {name: seen[:, i] for i, name in enumerate(OBSERVED_COLUMNS)}
    if terminal_state is None:
        keep = steps - 1
        extra = {name: values[:keep] for name, values in extra.items()}
        return EpisodeLog(start, state, action[:keep], dt[:keep], reward[:keep], metadata or {}, extra)
    return EpisodeLog(
        time=np.append(start, start[-1] + dt[-1]),
        state=np.vstack([state, np.asarray(terminal_state, dtype=np.float64)[None]]),
        action=action,
        dt=dt,
        reward=reward,
        metadata=metadata or {},
        extra=extra,
    )


def _drop_mass(observed: np.ndarray) -> np.ndarray:
    return observed[:, OBSERVATION_INDICES] if observed.shape[1] == STATE_DIM else observed


def _state_of_observed(observed: np.ndarray) -> np.ndarray:
    if observed.shape[1] == STATE_DIM:
        return observed
    state = np.full((len(observed), len(STATE_NAMES)), np.nan)
    state[:, OBSERVATION_INDICES] = observed
    return state
