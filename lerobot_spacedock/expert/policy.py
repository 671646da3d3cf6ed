"""What an expert is: a batched policy from what is observed to a body wrench; and the frame in which all are written.

Every law is derived for the approach from -V-bar (Zvezda's aft port). HCW motion is unchanged by a half turn about
the orbit normal, which carries that approach to the one from +V-bar: with body axes rolled by half a turn as well, so
that the nominal attitudes map to each other, the whole map is a change of signs, exact, and its own inverse.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.constants import THRUST_LIMIT_N, TORQUE_LIMIT_Nm
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port
from lerobot_spacedock.physics.frames import ACTION_DIM, OBSERVATION_NAMES

OBSERVATION_DIM = len(OBSERVATION_NAMES)
ACTION_LIMITS = np.array([THRUST_LIMIT_N] * 3 + [TORQUE_LIMIT_Nm] * 3)
# order: r, v, q, w; a half turn about z_H, and one about z_B
_OBSERVATION_SIGNS = np.array([-1, -1, 1, -1, -1, 1, 1, -1, -1, 1, -1, -1, 1], dtype=np.float64)
_ACTION_SIGNS = np.array([-1, -1, 1, -1, -1, 1], dtype=np.float64)


class Policy(Protocol):
    """A policy over a batch of chasers."""

    def reset(self, count: int) -> None:
        """Forgets everything; the next ``act`` is the first of ``count`` new episodes."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """(N, 13) ``observation.state`` (m, m/s, quaternion, deg/s) → (N, 6) N and N·m, within the limits."""


def observation_signs(port: Port) -> np.ndarray:
    """(13,) signs that turn an observation at ``port`` into the same one seen at Zvezda's aft port."""
    return np.ones(OBSERVATION_DIM) if port.axis_sign == ZVEZDA_AFT.axis_sign else _OBSERVATION_SIGNS


def action_signs(port: Port) -> np.ndarray:
    """(6,) signs that turn a command for Zvezda's aft port into the same one at ``port``."""
    return np.ones(ACTION_DIM) if port.axis_sign == ZVEZDA_AFT.axis_sign else _ACTION_SIGNS


def check_observation(observation: np.ndarray, count: int | None = None) -> np.ndarray:
    """``observation`` as float64, (N, 13).

    Raises:
        InputError: another shape, another number of chasers than ``reset`` announced, or a value that is not finite.
    """
    observation = np.asarray(observation, dtype=np.float64)
    if observation.ndim != 2 or observation.shape[1] != OBSERVATION_DIM:
        raise InputError(
            "observation",
            f"shape {observation.shape}",
            f"(N, {OBSERVATION_DIM}): {', '.join(OBSERVATION_NAMES)}",
            "An observation.state with mass (14 values) has to lose its seventh first.",
        )
    if count is not None and len(observation) != count:
        raise InputError(
            "observation", f"{len(observation)} rows", f"{count}, as reset() was told", "Call reset(count) first."
        )
    if not np.isfinite(observation).all():
        row, column = np.argwhere(~np.isfinite(observation))[0]
        raise InputError(
            "observation", f"{observation[row, column]} as {OBSERVATION_NAMES[column]} of row {row}", "finite numbers"
        )
    return observation
