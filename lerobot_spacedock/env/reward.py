"""The reward: bounded terms, each a function of its own; Numba rows for the steps, NumPy for the terminal bonus.

Per step ``scale * (alive - Σ weight_i * cost_i)`` with every cost in [0, 1]; at the end of an episode
``scale * terminal * Σ bonus_j`` on top, each bonus in [0, 1] times its published factor. Costs are built of a slope
that is felt from far away and a well that is felt near the goal, so that there is a gradient everywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lerobot_spacedock.env.reward_config import RewardConfig

STEP_TERMS = ("alive", "velocity", "lateral", "attitude", "rate", "effort", "smoothness")
TERMINAL_FACTORS = {
    "miss_fine": 5.0,
    "miss": 5.0,
    "closing": 5.0,
    "drift": 3.0,
    "pointing": 3.0,
    "tumble": 2.0,
    "idss": 10.0,
}


def packed_weights(config: RewardConfig) -> np.ndarray:
    """The kernel's layout, (13,) float64."""
    return np.array(
        [
            config.closing_speed_m_s,
            config.profile_deceleration_m_s2,
            config.profile_max_speed_m_s,
            config.lateral_time_s,
            config.attitude_time_s,
            config.alive,
            config.velocity,
            config.lateral,
            config.attitude,
            config.rate,
            config.effort,
            config.smoothness,
            config.scale,
        ]
    )


@njit(cache=True, inline="always")
def well(value, width):
    """0 at 0, towards 1 beyond ``width``: a Gaussian well."""
    return 1.0 - math.exp(-((value / width) ** 2))


@njit(cache=True, inline="always")
def slope(value, width):
    """Linear from 0 to 1 at ``width``, then 1."""
    return min(value / width, 1.0)


@njit(cache=True)
def velocity_cost(velocity_error_m_s):
    """Distance from the wanted velocity, m/s, in [0, 1]."""
    e = velocity_error_m_s
    return 0.19 * slope(e, 2.0) + 0.26 * slope(e, 0.5) + 0.23 * well(e, 0.03) + 0.32 * (1.0 - math.exp(-e / 0.12))


@njit(cache=True)
def lateral_cost(lateral_m):
    """Offset from the docking axis, m, in [0, 1]."""
    return 0.25 * slope(lateral_m, 10.0) + 0.375 * slope(lateral_m, 1.0) + 0.375 * well(lateral_m, 0.1)


@njit(cache=True)
def attitude_cost(angle_deg):
    """Angle to the nominal attitude, deg, in [0, 1]."""
    return 0.375 * slope(angle_deg, 60.0) + 0.25 * slope(angle_deg, 10.0) + 0.375 * well(angle_deg, 1.5)


@njit(cache=True)
def rate_cost(rate_error_deg_s, rate_deg_s):
    """Distance from the wanted rate, and the rate itself, deg/s, in [0, 1]."""
    near, far = well(rate_error_deg_s, 0.15), slope(rate_error_deg_s, 2.0)
    return 0.43 * near + 0.43 * far + 0.14 * slope(rate_deg_s, 5.0)


@njit(cache=True)
def wanted_velocity(axial_m, x, z, weights):
    """(closing speed, x rate, z rate), m/s, that the reward asks for at a place: a law of the place alone."""
    speed = min(math.sqrt(weights[0] ** 2 + 2.0 * weights[1] * max(axial_m, 0.0)), weights[2])
    return speed, -x / weights[3], -z / weights[3]


@njit(cache=True)
def step_terms(axial_sign, r, v, error, omega, action, previous, limits, weights, terms, i):
    """Fills ``terms[i]`` with the weighted terms (``STEP_TERMS``, costs negative) and returns their sum.

    Args:
        axial_sign: of the port's outward normal along y.
        r: m, 3-tuple, Hill. v: m/s.
        error: 4-tuple, attitude relative to nominal, body axes.
        omega: rad/s, 3-tuple, body rate relative to the station.
        action, previous: 6-tuples, N and N·m; limits: (6,) their bounds.
        weights: ``packed_weights``.
    """
    axial = axial_sign * r[1]
    lateral = math.hypot(r[0], r[2])
    speed, wanted_x, wanted_z = wanted_velocity(axial, r[0], r[2], weights)
    velocity_error = math.sqrt((-axial_sign * v[1] - speed) ** 2 + (v[0] - wanted_x) ** 2 + (v[2] - wanted_z) ** 2)

    sign = 1.0 if error[0] >= 0.0 else -1.0
    sine = math.sqrt(error[1] ** 2 + error[2] ** 2 + error[3] ** 2)
    angle = 2.0 * math.atan2(sine, abs(error[0]))
    per_sine = sign * (angle / sine if sine > 1e-12 else 2.0) / weights[4]
    to_deg = 180.0 / math.pi
    rate_error = to_deg * math.sqrt(
        (omega[0] + per_sine * error[1]) ** 2
        + (omega[1] + per_sine * error[2]) ** 2
        + (omega[2] + per_sine * error[3]) ** 2
    )
    rate = to_deg * math.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2)

    effort, change = 0.0, 0.0
    for j in range(6):
        effort += (action[j] / limits[j]) ** 2 / 6.0
        change += ((action[j] - previous[j]) / (2.0 * limits[j])) ** 2 / 6.0

    scale = weights[12]
    terms[i, 0] = scale * weights[5]
    terms[i, 1] = -scale * weights[6] * velocity_cost(velocity_error)
    terms[i, 2] = -scale * weights[7] * lateral_cost(lateral)
    terms[i, 3] = -scale * weights[8] * attitude_cost(to_deg * angle)
    terms[i, 4] = -scale * weights[9] * rate_cost(rate_error, rate)
    terms[i, 5] = -scale * weights[10] * effort
    terms[i, 6] = -scale * weights[11] * change
    total = 0.0
    for j in range(7):
        total += terms[i, j]
    return total


def terminal_bonus(report: dict[str, np.ndarray], miss_m: np.ndarray, config: RewardConfig) -> np.ndarray:
    """Bonus of the states at which episodes ended, (N,).

    Args:
        report: as from ``physics.contact.contact_report``.
        miss_m: (N,) lateral miss at contact, or the distance to the port where there is no contact.
        config: weights.
    """

    def peak(value: np.ndarray, width: float) -> np.ndarray:
        return np.exp(-((np.asarray(value) / width) ** 2))

    attitude = np.hypot(report["pitch_yaw_deg"], report["roll_deg"])
    rate = np.hypot(report["pitch_yaw_rate_deg_s"], report["roll_rate_deg_s"])
    bonuses = {
        "miss_fine": peak(miss_m, 0.05),
        "miss": np.exp(-np.asarray(miss_m) / 0.3),
        "closing": peak(report["closing_speed_m_s"] - config.closing_speed_m_s, 0.02),
        "drift": peak(report["lateral_speed_m_s"], 0.02),
        "pointing": peak(attitude, 1.5),
        "tumble": peak(rate, 0.1),
        "idss": np.asarray(report["idss"], dtype=np.float64),
    }
    return config.scale * config.terminal * sum(TERMINAL_FACTORS[name] * value for name, value in bonuses.items())
