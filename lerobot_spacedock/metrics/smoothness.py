"""How rough the commands are: the mean norm of their first difference over an episode (Eq. 4 of the paper)."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.metrics.lengths import lengths
from lerobot_spacedock.physics.constants import THRUST_LIMIT_N, TORQUE_LIMIT_Nm

COMMAND_LIMITS = np.array([THRUST_LIMIT_N] * 3 + [TORQUE_LIMIT_Nm] * 3)


def smoothness(action: np.ndarray, dt: np.ndarray, limits: np.ndarray = COMMAND_LIMITS) -> dict[str, float | None]:
    """All smoothness numbers of one episode.

    Args:
        action: N and N·m, (K, 6).
        dt: s, (K,).
        limits: N and N·m, (6,), of the chaser.

    Returns:
        ``smoothness`` as in the paper (the norm mixes N and N·m), thrust and torque apart, the six commands as
        shares of their limits, and each per second.
    """
    change = np.diff(action, axis=0)
    thrust, torque, share = (lengths(part) for part in (change[:, :3], change[:, 3:], change / limits))
    seconds = float(dt[:-1].sum())
    return {
        "smoothness": _mean(lengths(change)),
        "smoothness_thrust_N": _mean(thrust),
        "smoothness_torque_Nm": _mean(torque),
        "smoothness_per_limit": _mean(share),
        "smoothness_thrust_N_s": _per_second(thrust, seconds),
        "smoothness_torque_Nm_s": _per_second(torque, seconds),
        "smoothness_per_limit_s": _per_second(share, seconds),
    }


def _mean(changes: np.ndarray) -> float | None:
    """Eq. 4, of ‖a_{k+1} − a_k‖, (K−1,); ``None`` for fewer than two commands."""
    return float(changes.mean()) if len(changes) else None


def _per_second(changes: np.ndarray, seconds: float) -> float | None:
    """Over the time between the first command and the last; does not depend on the step length."""
    return float(changes.sum() / seconds) if len(changes) and seconds > 0.0 else None
