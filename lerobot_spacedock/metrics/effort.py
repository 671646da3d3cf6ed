"""What the approach cost: impulse, Δv, propellant, and how often the commands met their limits."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.metrics.lengths import lengths
from lerobot_spacedock.metrics.smoothness import COMMAND_LIMITS

LIMIT_TOLERANCE = 1e-6  # of the limit: a command this near counts as saturated (float32 commands)


def effort(
    action: np.ndarray, dt: np.ndarray, mass: np.ndarray, limits: np.ndarray = COMMAND_LIMITS
) -> dict[str, float | None]:
    """All effort numbers of one episode; an episode without a step cost nothing.

    Args:
        action: N and N·m, (K, 6).
        dt: s, (K,).
        mass: kg, (K+1,), as logged.
        limits: N and N·m, (6,), of the chaser.

    Returns:
        ``delta_v_m_s`` takes the mean mass of each step (the relative error is a twelfth of the square of the burnt
        share); ``None`` where a mass is not above 0. ``propellant_kg`` is ``None`` where thrust was commanded and the
        logged mass never changes: then the log's maker did not track it.
    """
    thrust, torque = lengths(action[:, :3]), lengths(action[:, 3:])
    impulse = float(np.sum(thrust * dt))
    tracked = impulse == 0.0 or mass[0] != mass[-1]
    saturated = np.abs(action) >= limits * (1.0 - LIMIT_TOLERANCE)
    return {
        "delta_v_m_s": float(np.sum(thrust * dt / (0.5 * (mass[1:] + mass[:-1])))) if (mass > 0.0).all() else None,
        "propellant_kg": float(mass[0] - mass[-1]) if tracked else None,
        "impulse_N_s": impulse,
        "angular_impulse_N_m_s": float(np.sum(torque * dt)),
        "peak_thrust_N": float(thrust.max(initial=0.0)),
        "peak_torque_Nm": float(torque.max(initial=0.0)),
        "saturated_share": float(saturated.any(axis=1).mean()) if len(action) else 0.0,
    }
