"""Checks what a caller gives to ``reset(options=…)`` and ``step``."""

from __future__ import annotations

from typing import Any

import numpy as np

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.frames import (
    ACTION_DIM,
    ACTION_NAMES,
    MASS,
    QUATERNION,
    STATE_DIM,
    STATE_NAMES,
    state_from_dataset_units,
)

MAX_QUATERNION_ERROR = 1e-3  # float32 datasets are off by 1e-7; more than this is another quantity
MAX_STEP_s = 1e4  # beyond the orbit's period a "step" is a mistake of units


def check_start(values: Any, *, default_mass_kg: float) -> np.ndarray:
    """A start as a user gives it: 13 values, or 14 with the mass, dataset order and units.

    Returns:
        (14,) SI with rad/s, unit quaternion.

    Raises:
        InputError: wrong count, not finite, a quaternion that is not a unit one, or a mass that is not positive.
    """
    state = _numbers("state", values)
    if state.shape == (STATE_DIM - 1,):
        state = np.insert(state, MASS, default_mass_kg)
    if state.shape != (STATE_DIM,):
        raise InputError("state", f"shape {state.shape}", f"14 values ({', '.join(STATE_NAMES)}) or 13, without mass")
    bad = np.flatnonzero(~np.isfinite(state))
    if bad.size:
        raise InputError("state", f"{STATE_NAMES[bad[0]]} = {state[bad[0]]}", "finite values")
    if state[MASS] <= 0.0:
        raise InputError("state", f"mass = {state[MASS]} kg", "a mass > 0")
    norm = float(np.linalg.norm(state[QUATERNION]))
    if abs(norm - 1.0) > MAX_QUATERNION_ERROR:
        raise InputError("state", f"a quaternion of norm {norm:.6g}", "a unit quaternion, scalar first")
    state[QUATERNION] /= norm
    return state_from_dataset_units(state)


def check_time_steps(values: Any) -> np.ndarray:
    """Step lengths in s, (K,), each positive, so that times increase.

    Raises:
        InputError: empty, not one-dimensional, not finite, or a step that is not positive or is absurdly long.
    """
    steps = _numbers("time_steps", values)
    if steps.ndim != 1 or steps.size == 0:
        raise InputError("time_steps", f"shape {steps.shape}", "at least one step length, s, in one dimension")
    bad = np.flatnonzero(~((steps > 0.0) & (steps <= MAX_STEP_s)))
    if bad.size:
        raise InputError(
            "time_steps",
            f"{steps[bad[0]]} s at index {bad[0]}",
            f"step lengths > 0 and ≤ {MAX_STEP_s:g} s, so that times increase",
            "Pass differences of times, not the times themselves.",
        )
    return steps


def check_action(values: Any) -> np.ndarray:
    """A command, N and N·m in body axes, (6,); whether it is finite is for the simulator to say.

    Raises:
        InputError: wrong shape, or not numeric.
    """
    names = ", ".join(ACTION_NAMES)
    action = _numbers("action", values, f"{ACTION_DIM} numbers: {names}")
    if action.shape != (ACTION_DIM,):
        raise InputError("action", f"shape {action.shape}", f"({ACTION_DIM},): {names}")
    return action


def _numbers(name: str, values: Any, allowed: str = "numbers") -> np.ndarray:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(name, values, allowed) from error
