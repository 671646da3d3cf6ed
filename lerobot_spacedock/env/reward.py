"""The reward: terms that are functions of their own; Numba rows for the steps, NumPy for the terminal bonus.

Per step ``scale * (alive - Σ weight_i * cost_i)``. Each cost is a bounded logarithmic well: quadratic where the error
is small against its scale, so that the best behaviour is a smooth one, and logarithmic far away, so that metres and
centimetres, tumbling and a tenth of a degree are felt alike and no single term drowns the others. At the end of an
episode ``scale * terminal * Σ bonus_j`` on top, each bonus in [0, 1] times its published factor.

Wanted is a velocity that depends on the place alone (``SpeedProfile`` along the axis, a time constant across it) and a
rate that depends on the attitude alone: nothing in the reward has a clock, so neither has the policy that it makes.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.speed_profile import SpeedProfile
from lerobot_spacedock.jit import jit

STEP_TERMS = ("alive", "closing", "drift", "lateral", "attitude", "rate", "smoothness")
TERMINAL_FACTORS = {
    "miss_fine": 5.0,
    "miss": 5.0,
    "closing": 5.0,
    "drift": 3.0,
    "pointing": 3.0,
    "tumble": 2.0,
    "idss": 10.0,
}

_SCALARS = (
    "lateral_time_s",
    "attitude_time_s",
    "alive",
    "closing",
    "closing_scale_m_s",
    "drift",
    "drift_scale_m_s",
    "drift_scale_per_m",
    "lateral",
    "lateral_scale_m",
    "lateral_scale_per_m",
    "attitude",
    "attitude_scale_deg",
    "rate",
    "rate_scale_deg_s",
    "smoothness",
    "scale",
)
# where each stands in the packed weights; the speed table follows
(
    LATERAL_TIME, ATTITUDE_TIME, ALIVE, CLOSING, CLOSING_SCALE, DRIFT, DRIFT_SCALE, DRIFT_GROWTH, LATERAL,
    LATERAL_SCALE, LATERAL_GROWTH, ATTITUDE, ATTITUDE_SCALE, RATE, RATE_SCALE, SMOOTHNESS, SCALE,
) = range(17)  # fmt: skip
TABLE = 17
TABLE_SPACING_m = 0.05
TABLE_SIZE = 801  # to 40 m; farther out the last value holds


def speed_profile(config: RewardConfig) -> SpeedProfile:
    """The closing speed that the reward asks for."""
    return SpeedProfile(
        contact_m_s=config.closing_speed_m_s,
        cruise_m_s=config.cruise_speed_m_s,
        braking_s=config.braking_time_s,
        power=config.braking_power,
    )


def packed_weights(config: RewardConfig) -> np.ndarray:
    """The kernel's layout, (TABLE + TABLE_SIZE,) float64."""
    scalars = [getattr(config, name) for name in _SCALARS]
    return np.concatenate([scalars, speed_profile(config).sampled(TABLE_SPACING_m, TABLE_SIZE)])


# bounds every cost; reached at 22,000 scales, which no flight inside the volume does
LOG_WELL_CAP = 10.0


@jit(inline="always")
def log_well(value, scale):
    """``½ ln(1 + (value / scale)²)``, at most ``LOG_WELL_CAP``."""
    return min(0.5 * math.log1p((value / scale) ** 2), LOG_WELL_CAP)


@jit
def wanted_closing_speed(axial_m, weights):
    """m/s, at an axial distance: linear between the table's entries, constant beyond its ends."""
    at = axial_m / TABLE_SPACING_m
    if at <= 0.0:
        return weights[TABLE]
    left = int(at)
    if left >= TABLE_SIZE - 1:
        return weights[TABLE + TABLE_SIZE - 1]
    fraction = at - left
    return (1.0 - fraction) * weights[TABLE + left] + fraction * weights[TABLE + left + 1]


@jit
def step_terms(axial_sign, r, v, error, omega, action, previous, first, weights, terms, i):
    """Fills ``terms[i]`` with the weighted terms (``STEP_TERMS``, costs negative) and returns their sum.

    Args:
        axial_sign: of the port's outward normal along y.
        r: m, 3-tuple, Hill. v: m/s.
        error: 4-tuple, attitude relative to nominal, body axes.
        omega: rad/s, 3-tuple, body rate relative to the station.
        action, previous: 6-tuples, N and N·m.
        first: there is no previous command.
        weights: ``packed_weights``.
    """
    w = weights
    axial = axial_sign * r[1]
    to_go = max(axial, 0.0)
    closing_error = -axial_sign * v[1] - wanted_closing_speed(axial, w)
    drift_error = math.hypot(v[0] + r[0] / w[LATERAL_TIME], v[2] + r[2] / w[LATERAL_TIME])

    sign = 1.0 if error[0] >= 0.0 else -1.0
    sine = math.sqrt(error[1] ** 2 + error[2] ** 2 + error[3] ** 2)
    angle = 2.0 * math.atan2(sine, abs(error[0]))
    per_sine = sign * (angle / sine if sine > 1e-12 else 2.0) / w[ATTITUDE_TIME]
    to_deg = 180.0 / math.pi
    rate_error = to_deg * math.sqrt(
        (omega[0] + per_sine * error[1]) ** 2
        + (omega[1] + per_sine * error[2]) ** 2
        + (omega[2] + per_sine * error[3]) ** 2
    )

    change = 0.0
    if not first:
        for j in range(6):
            change += (action[j] - previous[j]) ** 2

    lateral = math.hypot(r[0], r[2])
    scale = w[SCALE]
    terms[i, 0] = scale * w[ALIVE]
    terms[i, 1] = -scale * w[CLOSING] * log_well(closing_error, w[CLOSING_SCALE])
    terms[i, 2] = -scale * w[DRIFT] * log_well(drift_error, w[DRIFT_SCALE] + w[DRIFT_GROWTH] * to_go)
    terms[i, 3] = -scale * w[LATERAL] * log_well(lateral, w[LATERAL_SCALE] + w[LATERAL_GROWTH] * to_go)
    terms[i, 4] = -scale * w[ATTITUDE] * log_well(to_deg * angle, w[ATTITUDE_SCALE])
    terms[i, 5] = -scale * w[RATE] * log_well(rate_error, w[RATE_SCALE])
    terms[i, 6] = -scale * w[SMOOTHNESS] * math.sqrt(change)
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
