"""How rough the commands are: the mean norm of their first difference over an episode (Eq. 4 of the paper)."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.physics.constants import THRUST_LIMIT_N, TORQUE_LIMIT_Nm

COMMAND_LIMITS = np.array([THRUST_LIMIT_N] * 3 + [TORQUE_LIMIT_Nm] * 3)


def mean_difference(action: np.ndarray) -> float | None:
    """Eq. 4: mean over steps of ‖a_{k+1} − a_k‖. (K, D) → float; ``None`` for fewer than two commands."""
    if len(action) < 2:
        return None
    return float(np.linalg.norm(np.diff(action, axis=0), axis=1).mean())


def total_difference_per_second(action: np.ndarray, dt: np.ndarray) -> float | None:
    """Σ‖a_{k+1} − a_k‖ over the time between the first command and the last; does not depend on the step length.

    Args:
        action: (K, D).
        dt: s, (K,), how long each command was held.
    """
    if len(action) < 2 or dt[:-1].sum() <= 0.0:
        return None
    return float(np.linalg.norm(np.diff(action, axis=0), axis=1).sum() / dt[:-1].sum())


def smoothness(action: np.ndarray, dt: np.ndarray) -> dict[str, float | None]:
    """All smoothness numbers of one episode.

    Args:
        action: N and N·m, (K, 6).
        dt: s, (K,).

    Returns:
        ``smoothness`` as in the paper (the norm mixes N and N·m), thrust and torque apart, the six commands as
        shares of their limits, and each per second.
    """
    thrust, torque, share = action[:, :3], action[:, 3:], action / COMMAND_LIMITS
    return {
        "smoothness": mean_difference(action),
        "smoothness_thrust_N": mean_difference(thrust),
        "smoothness_torque_Nm": mean_difference(torque),
        "smoothness_per_limit": mean_difference(share),
        "smoothness_thrust_N_s": total_difference_per_second(thrust, dt),
        "smoothness_torque_Nm_s": total_difference_per_second(torque, dt),
        "smoothness_per_limit_s": total_difference_per_second(share, dt),
    }
