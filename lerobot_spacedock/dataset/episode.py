"""Between the episode log and the rows of a dataset: the same episode, seen twice.

An episode travels through this room as an ``EpisodeLog``: ``state`` is the truth, ``action`` what flew.
Where the label differs from what flew, or the observation from the truth, the log carries both in further
columns.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.episode_log import OBSERVED, EpisodeLog, observed_columns
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics.episode import episode_metrics
from lerobot_spacedock.physics.frames import ACTION_NAMES, OBSERVATION_NAMES, STATE_NAMES, observed_indices

LABEL_COLUMNS = tuple(f"label_{name}" for name in ACTION_NAMES)


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
        extra |= observed_columns(observed)
    return extra


def reading_columns(seen: np.ndarray, state: np.ndarray) -> dict[str, np.ndarray]:
    """The further log columns of what a policy saw; none where that is the truth, to float32.

    Args:
        seen: dataset units, (K, 13), with the mass one more, without the pose seven fewer.
        state: (K, 14), the truth.

    Raises:
        InputError: seen holds another number of values.
    """
    shown = dict(zip(schema.observed_names(seen.shape[1]), seen.T, strict=True))
    shown.pop("mass", None)
    exact = all(
        np.array_equal(np.float32(values), np.float32(state[:, STATE_NAMES.index(name)]))
        for name, values in shown.items()
    )
    return {} if exact else {OBSERVED + name: values.astype(np.float64) for name, values in shown.items()}


def label_of(log: EpisodeLog) -> np.ndarray:
    """N and N·m, (K, 6): the label, which is the executed command unless the log says otherwise."""
    if not all(name in log.extra for name in LABEL_COLUMNS):
        return log.action
    return np.stack([log.extra[name][: log.num_steps] for name in LABEL_COLUMNS], axis=1)


def observed_of(log: EpisodeLog, *, with_mass: bool = False, withhold_pose: bool = False) -> np.ndarray:
    """What the policy saw, which is the truth unless the log says otherwise.

    Returns:
        dataset units, (K, 13); with the mass one more, without the pose seven fewer.

    Raises:
        InputError: a pose is wanted of a log whose sensors showed none.
    """
    wanted = observed_indices(with_mass=with_mass, withhold_pose=withhold_pose)
    seen = log.state[:-1, wanted].copy()
    shown = [name for name in OBSERVATION_NAMES if OBSERVED + name in log.extra]
    for column, name in enumerate(STATE_NAMES[i] for i in wanted):
        if name in shown:
            seen[:, column] = log.extra[OBSERVED + name][: log.num_steps]
        elif shown and name != "mass":
            raise InputError("observed values", f"a log without observed_{name}", "a log with it, or --withhold_pose")
    return seen


def succeeded(log: EpisodeLog) -> bool:
    """Whether it docked: as the log states it, else by the IDSS box."""
    return bool(episode_metrics(log)["success"] if log.metadata.get("success") is None else log.metadata["success"])


def rows_of(log: EpisodeLog, *, with_mass: bool = False, withhold_pose: bool = False) -> dict[str, np.ndarray]:
    """The dataset's columns, image apart, for the K frames of an episode; scalars as (K, 1)."""
    steps = log.num_steps
    last = np.arange(steps)[:, None] == steps - 1
    return {
        schema.STATE: observed_of(log, with_mass=with_mass, withhold_pose=withhold_pose).astype(np.float32),
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

    Raises:
        InputError: no such ``observation.state`` is known, or it has no pose and ``true_state`` is missing.
    """
    rows = {name: np.asarray(values, dtype=np.float64) for name, values in rows.items()}
    steps = len(rows[schema.STATE])
    dt = rows[schema.CONTROL_DT].reshape(steps)
    start = rows[schema.SIM_TIME].reshape(steps)
    seen = dict(zip(schema.observed_names(rows[schema.STATE].shape[1]), rows[schema.STATE].T, strict=True))
    state = rows[schema.TRUE_STATE] if schema.TRUE_STATE in rows else _state_of(seen)
    action = rows.get(schema.EXECUTED_ACTION, rows[schema.ACTION])
    reward = rows[schema.REWARD].reshape(steps) if schema.REWARD in rows else np.zeros(steps)
    extra = {}
    if schema.EXECUTED_ACTION in rows and not np.array_equal(rows[schema.ACTION], action):
        extra |= teaching_columns(label=rows[schema.ACTION])
    if schema.TRUE_STATE in rows:
        extra |= reading_columns(rows[schema.STATE], state)
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


def _state_of(seen: dict[str, np.ndarray]) -> np.ndarray:
    if "x" not in seen:
        raise InputError("dataset", f"{schema.STATE} without the pose, and no {schema.TRUE_STATE}", "one of the two")
    missing = np.full_like(seen["x"], np.nan)  # the mass is not invented
    return np.stack([seen.get(name, missing) for name in STATE_NAMES], axis=1)
