"""Do states follow from commands under the dynamics? Each step is flown again and compared with the next state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.physics.chaser import ChaserParameters
from lerobot_spacedock.physics.constants import CHASER_MASS_kg, STANDARD_GRAVITY_m_s2
from lerobot_spacedock.physics.frames import (
    MASS,
    POSITION,
    QUATERNION,
    RAD_TO_DEG,
    RATE,
    VELOCITY,
    state_from_dataset_units,
)
from lerobot_spacedock.physics.propagate import propagate

# what float32 rows leave of an exact step (25 m: 2e-6 m; 1000 kg: 6e-5 kg), with room for another integrator
TOLERANCES = {
    "position_m": 1e-4,
    "velocity_m_s": 1e-5,
    "mass_kg": 1e-3,
    "attitude_rad": 1e-5,
    "rate_deg_s": 1e-4,
}


def chaser_of(metadata: Mapping[str, Any]) -> ChaserParameters:
    """The chaser that an episode's metadata describe under ``dynamics``; the reference chaser without."""
    drawn = metadata.get("dynamics")
    nominal = ChaserParameters.nominal()
    if not isinstance(drawn, Mapping):
        return nominal
    return ChaserParameters(
        inertia_kg_m2=np.array([drawn["inertia_kg_m2"]]),
        thrust_map=np.array([drawn["thrust_map"]]),
        torque_map=np.array([drawn["torque_map"]]),
        torque_bias_Nm=np.array([drawn["torque_bias_Nm"]]),
        com_offset_m=np.array([drawn["com_offset_m"]]),
        specific_impulse_s=nominal.specific_impulse_s,
    )


def residuals(log: EpisodeLog, *, hill_coupling: bool) -> dict[str, np.ndarray]:
    """How far each next state is from the one that the command leads to.

    Args:
        log: an episode; where its mass is not a number it is integrated from the nominal one.
        hill_coupling: the attitude model flown in.

    Returns:
        (K,) arrays, norms or magnitudes, by the keys of ``TOLERANCES``.
    """
    state = state_from_dataset_units(log.state)
    chaser = chaser_of(log.metadata)
    if not np.isfinite(state[:, MASS]).all():
        state[:, MASS] = _integrated_mass(log, chaser)
    flown = propagate(state[:-1], log.action, log.dt, chaser, hill_coupling=hill_coupling)
    after = state[1:]
    return {
        "position_m": np.linalg.norm(flown[:, POSITION] - after[:, POSITION], axis=1),
        "velocity_m_s": np.linalg.norm(flown[:, VELOCITY] - after[:, VELOCITY], axis=1),
        "mass_kg": np.abs(flown[:, MASS] - after[:, MASS]),
        "attitude_rad": _angle(flown[:, QUATERNION], _unit(after[:, QUATERNION])),
        "rate_deg_s": np.linalg.norm(flown[:, RATE] - after[:, RATE], axis=1) * RAD_TO_DEG,
    }


def best_coupling(log: EpisodeLog) -> bool:
    """Which attitude model fits an episode that does not say."""
    worst = {c: float(np.max(residuals(log, hill_coupling=c)["attitude_rad"])) for c in (False, True)}
    return worst[True] < worst[False]


def _integrated_mass(log: EpisodeLog, chaser: ChaserParameters) -> np.ndarray:
    thrust = log.action[:, :3] @ np.asarray(chaser.thrust_map[0]).T
    exhaust_m_s = float(chaser.specific_impulse_s[0]) * STANDARD_GRAVITY_m_s2
    used = np.linalg.norm(thrust, axis=1) * log.dt / exhaust_m_s
    return CHASER_MASS_kg - np.concatenate([[0.0], np.cumsum(used)])


def _unit(q: np.ndarray) -> np.ndarray:
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """rad between attitudes, by the chord: the arc cosine of their overlap loses half its digits near 1."""
    chord = np.minimum(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    return 4.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))
