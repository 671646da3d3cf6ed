"""The reward: terms that are functions of their own; Numba rows for the steps, NumPy for the terminal bonus.

Per step ``scale * (alive - Σ weight_i * cost_i)``. The cost of an error is a bounded logarithmic well: quadratic where
it is small against its scale, so that the best behaviour is a smooth one, and logarithmic far away, so that metres and
centimetres, tumbling and a tenth of a degree are felt alike and no single term drowns the others. The change of the
command is charged in proportion. At the end of an episode ``scale * terminal * Σ bonus_j`` on top, each bonus in [0, 1]
times its published factor.

Wanted is a velocity that depends on the place alone (``SpeedProfile`` along the axis, a time constant across it) and a
rate that depends on the attitude alone: nothing in the reward has a clock, so neither has the policy that it makes.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.speed_profile import SpeedProfile
from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics.elementary import angle_of, log_positive

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


@jit(forceinline=True)
def log_well(value, scale):
    """``½ ln(1 + (value / scale)²)``, at most ``LOG_WELL_CAP``."""
    ratio = value / scale
    depth = 0.5 * log_positive(1.0 + ratio * ratio)
    return depth if depth < LOG_WELL_CAP else LOG_WELL_CAP


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


@jit(forceinline=True)
def weight_scalars(w):
    """The scalars of ``packed_weights`` as a tuple: values that a loop need not read again."""
    return (
        w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7], w[8], w[9], w[10], w[11], w[12], w[13], w[14], w[15], w[16],
    )  # fmt: skip


@jit(forceinline=True)
def step_terms(axial_sign, r, v, error, omega, action, previous, wanted_m_s, changed, w):
    """The weighted terms of a step, 7-tuple (``STEP_TERMS``, costs negative). Without a branch: see ``kernels.py``.

    Args:
        axial_sign: of the port's outward normal along y.
        r: m, 3-tuple, Hill. v: m/s.
        error: 4-tuple, attitude relative to nominal, body axes.
        omega: rad/s, 3-tuple, body rate relative to the station.
        action, previous: 6-tuples, N and N·m.
        wanted_m_s: ``wanted_closing_speed`` at this place.
        changed: 1.0, or 0.0 where there is no previous command.
        w: the scalars of ``packed_weights``, tuple.
    """
    axial = axial_sign * r[1]
    to_go = axial if axial > 0.0 else 0.0
    closing_error = -axial_sign * v[1] - wanted_m_s
    drift_x, drift_z = v[0] + r[0] / w[LATERAL_TIME], v[2] + r[2] / w[LATERAL_TIME]
    drift_error = math.sqrt(drift_x * drift_x + drift_z * drift_z)

    sine = math.sqrt(error[1] * error[1] + error[2] * error[2] + error[3] * error[3])
    angle = 2.0 * angle_of(sine, abs(error[0]))
    per_sine = angle / (sine if sine > 1e-12 else 1.0)
    per_sine = per_sine if sine > 1e-12 else 2.0
    per_sine = (per_sine if error[0] >= 0.0 else -per_sine) / w[ATTITUDE_TIME]
    rate_x, rate_y = omega[0] + per_sine * error[1], omega[1] + per_sine * error[2]
    rate_z = omega[2] + per_sine * error[3]
    to_deg = 180.0 / math.pi
    rate_error = to_deg * math.sqrt(rate_x * rate_x + rate_y * rate_y + rate_z * rate_z)

    d0, d1, d2 = action[0] - previous[0], action[1] - previous[1], action[2] - previous[2]
    d3, d4, d5 = action[3] - previous[3], action[4] - previous[4], action[5] - previous[5]
    change = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3 + d4 * d4 + d5 * d5)

    lateral = math.sqrt(r[0] * r[0] + r[2] * r[2])
    scale = w[SCALE]
    return (
        scale * w[ALIVE],
        -scale * w[CLOSING] * log_well(closing_error, w[CLOSING_SCALE]),
        -scale * w[DRIFT] * log_well(drift_error, w[DRIFT_SCALE] + w[DRIFT_GROWTH] * to_go),
        -scale * w[LATERAL] * log_well(lateral, w[LATERAL_SCALE] + w[LATERAL_GROWTH] * to_go),
        -scale * w[ATTITUDE] * log_well(to_deg * angle, w[ATTITUDE_SCALE]),
        -scale * w[RATE] * log_well(rate_error, w[RATE_SCALE]),
        -scale * w[SMOOTHNESS] * (changed * change),
    )


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
