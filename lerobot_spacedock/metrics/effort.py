"""What the approach cost: impulse, Δv, propellant, and how often the commands met their limits."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.metrics.smoothness import COMMAND_LIMITS

LIMIT_TOLERANCE = 1e-6  # of the limit: a command this near counts as saturated (float32 commands)


def delta_v(thrust: np.ndarray, dt: np.ndarray, mass: np.ndarray) -> float:
    """m/s: Σ ‖T‖ Δt / m, with the mean mass of each step (exact to third order in the burnt share).

    Args:
        thrust: N, (K, 3).
        dt: s, (K,).
        mass: kg, (K+1,).
    """
    return float(np.sum(np.linalg.norm(thrust, axis=1) * dt / (0.5 * (mass[1:] + mass[:-1]))))


def effort(action: np.ndarray, dt: np.ndarray, mass: np.ndarray) -> dict[str, float | None]:
    """All effort numbers of one episode; an episode without a step cost nothing.

    Args:
        action: N and N·m, (K, 6).
        dt: s, (K,).
        mass: kg, (K+1,), as logged.

    Returns:
        ``propellant_kg`` is ``None`` where thrust was commanded and the logged mass never changes: then the log's
        maker did not track it.
    """
    impulse = float(np.sum(np.linalg.norm(action[:, :3], axis=1) * dt))
    tracked = impulse == 0.0 or mass[0] != mass[-1]
    saturated = np.abs(action) >= COMMAND_LIMITS * (1.0 - LIMIT_TOLERANCE)
    return {
        "delta_v_m_s": delta_v(action[:, :3], dt, mass),
        "propellant_kg": float(mass[0] - mass[-1]) if tracked else None,
        "impulse_N_s": impulse,
        "angular_impulse_N_m_s": float(np.sum(np.linalg.norm(action[:, 3:], axis=1) * dt)),
        "peak_thrust_N": float(np.linalg.norm(action[:, :3], axis=1).max(initial=0.0)),
        "peak_torque_Nm": float(np.linalg.norm(action[:, 3:], axis=1).max(initial=0.0)),
        "saturated_share": float(saturated.any(axis=1).mean()) if len(action) else 0.0,
    }
