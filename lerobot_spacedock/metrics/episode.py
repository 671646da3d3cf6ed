"""One episode log in, every number of ``catalog.CATALOG`` out; ``None`` where a number is not defined."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics.catalog import NAMES
from lerobot_spacedock.metrics.crossing import closest_approach, plane_crossing
from lerobot_spacedock.metrics.effort import effort
from lerobot_spacedock.metrics.smoothness import smoothness
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.constants import THRUST_LIMIT_N, TORQUE_LIMIT_Nm
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port, contact_report, contact_state, get_port, relative_rate
from lerobot_spacedock.physics.frames import (
    DEG_TO_RAD,
    MASS,
    POSITION,
    QUATERNION,
    VELOCITY,
    state_from_dataset_units,
)

AT_PLANE_TOLERANCE_M = 1e-3  # a logged contact this near the plane was taken on it
CORRIDOR_HALF_ANGLE_deg = 10.0  # the approach cone of the contact task, for logs that state none
CORRIDOR_MOUTH_m = 1.5
CONTACT_NUMBERS = (
    "lateral_m",
    "closing_speed_m_s",
    "lateral_speed_m_s",
    "pitch_yaw_deg",
    "roll_deg",
    "pitch_yaw_rate_deg_s",
    "roll_rate_deg_s",
)
IDSS_CONDITIONS = tuple(
    f"idss_{name}"
    for name in (
        "closing_speed",
        "lateral",
        "lateral_speed",
        "pitch_yaw",
        "roll",
        "pitch_yaw_rate",
        "roll_rate",
    )
)
ATV_CONDITIONS = ("atv_closing_speed", "atv_lateral")


def port_of(metadata: Mapping[str, Any]) -> Port:
    """The port that an episode flew to; Zvezda aft where the log does not say."""
    config = metadata.get("config")
    name = metadata.get("port") or (config.get("port") if isinstance(config, Mapping) else None)
    return get_port(name) if isinstance(name, str) else ZVEZDA_AFT


def hill_coupled(metadata: Mapping[str, Any]) -> bool:
    """Whether logged rates are inertial, the station turning; the reference rollouts (and unknown makers): no."""
    for source in (metadata, metadata.get("dynamics"), metadata.get("config")):
        if isinstance(source, Mapping) and "hill_coupling" in source:
            return bool(source["hill_coupling"])
    return False


def ends_at_contact(metadata: Mapping[str, Any]) -> bool:
    """Whether the episode's task is to touch the port, so that who did not reach its plane has not docked."""
    config = metadata.get("config")
    return isinstance(config, Mapping) and config.get("contact") is True


def corridor_of(metadata: Mapping[str, Any]) -> tuple[float, float]:
    """Half angle in rad and mouth radius in m of an episode's approach corridor, by default the contact task's."""
    config = metadata.get("config")
    corridor = config.get("corridor") if isinstance(config, Mapping) else None
    corridor = corridor if isinstance(corridor, Mapping) else {}
    angle = float(corridor.get("half_angle_deg", CORRIDOR_HALF_ANGLE_deg)) * DEG_TO_RAD
    return angle, float(corridor.get("mouth_radius_m", CORRIDOR_MOUTH_m))


def limits_of(metadata: Mapping[str, Any]) -> np.ndarray:
    """The chaser's largest thrust and torque along each axis, N and N·m, (6,); by default the paper's.

    Raises:
        InputError: a limit that is no number above 0.
    """
    config = metadata.get("config")
    config = config if isinstance(config, Mapping) else {}
    limits = []
    for name, usual in (("thrust_limit_N", THRUST_LIMIT_N), ("torque_limit_Nm", TORQUE_LIMIT_Nm)):
        value = config.get(name, usual)
        if not (isinstance(value, int | float) and 0.0 < value < np.inf):
            raise InputError(name, value, "a finite number above 0")
        limits += [float(value)] * 3
    return np.array(limits)


def corridor_margin(position: np.ndarray, port: Port, half_angle_rad: float, mouth_m: float) -> np.ndarray:
    """How far inside the approach corridor states lie; negative outside. m, (K, 3) → m, (K,).

    The corridor is a cone about the port axis, ``mouth_m`` in radius at the port plane and behind it.
    """
    allowed = mouth_m + np.tan(half_angle_rad) * np.maximum(port.axis_sign * position[:, 1], 0.0)
    return allowed - np.hypot(position[:, 0], position[:, 2])


def misalignment_deg(q_HB: np.ndarray, port: Port) -> float:
    """Angle between an attitude and the port's docking attitude. (4,), of any length but zero."""
    error = rotations.multiply(rotations.conjugate(np.array(port.q_nominal)), q_HB)
    return float(2.0 * np.arctan2(np.linalg.norm(error[1:]), abs(error[0])) / DEG_TO_RAD)


def judged_contact(
    log: EpisodeLog, state: np.ndarray, port: Port, crossing: tuple[float, np.ndarray] | None
) -> dict[str, float | bool]:
    """The contact that the log states; else the plane's crossing; else (never crossed) the last state.

    Args:
        log: the episode.
        state: its states in SI, (K+1, 14).
        port: the port.
        crossing: time and state at its plane, as ``plane_crossing`` found them.

    Returns:
        As ``physics.contact.contact_report``: numbers, each condition, each box. For a last state off the plane the
        boxes limit the whole distance, as for the fixed-horizon task.
    """
    stated = log.metadata.get("contact")
    if isinstance(stated, Mapping) and all(name in stated for name in (*CONTACT_NUMBERS, *IDSS_CONDITIONS, "idss")):
        return dict(stated)
    where = state[-1] if crossing is None else crossing[1]
    report = contact_report(
        contact_state(where, port, hill_coupling=hill_coupled(log.metadata)), at_plane=crossing is not None
    )
    return {name: value.item() for name, value in report.items()}


def inference(log: EpisodeLog) -> dict[str, float | None]:
    """How long the policy took for a step, of the whole batch that it was asked for, as the log states it.

    The log's ``inference`` says how many steps at the beginning were warm-up; they count neither way.
    """
    about = log.metadata.get("inference")
    about = about if isinstance(about, Mapping) else {}
    first, batch = about.get("warm_up_steps"), about.get("batch")
    seconds = log.extra.get("inference_s", np.empty(0))[first if isinstance(first, int) and first > 0 else 0 :]
    seconds = seconds[np.isfinite(seconds)]
    return {
        "inference_ms": float(seconds.mean() * 1e3) if len(seconds) else None,
        "inference_max_ms": float(seconds.max() * 1e3) if len(seconds) else None,
        "inference_batch": float(batch) if isinstance(batch, int) and len(seconds) else None,
    }


def episode_metrics(log: EpisodeLog) -> dict[str, float | bool | None]:
    """Every number of one episode: the names of ``catalog.NAMES``, then each IDSS and ATV condition.

    Where the task ends at contact and the plane was not reached, there is no contact: its numbers are ``None``, and the
    episode is outside the boxes. The conditions one by one are then those of the last state.

    Raises:
        InputError: a step back in time, by which durations, impulses and Δv would be negative.
    """
    _check_clock(log)
    port = port_of(log.metadata)
    state = state_from_dataset_units(log.state)
    position, velocity = state[:, POSITION], state[:, VELOCITY]
    crossing = plane_crossing(log.time, state, port)
    contact = judged_contact(log, state, port, crossing)
    at_plane = abs(float(contact.get("axial_m", np.inf))) <= AT_PLANE_TOLERANCE_M
    crossed = crossing is not None or (at_plane and isinstance(log.metadata.get("contact"), Mapping))
    outside = corridor_margin(position, port, *corridor_of(log.metadata)) < 0.0
    limits = limits_of(log.metadata)
    # a chaser that hovers before the port may be in the box, and has touched nothing
    touched = crossed or not ends_at_contact(log.metadata)
    idss = bool(contact["idss"]) and touched
    met_box = idss or (crossing is not None and _met_idss(crossing[1], port, log.metadata))
    # of the chaser as the station sees it: what the docking conditions limit
    final_rate = relative_rate(state[-1], hill_coupling=hill_coupled(log.metadata)) / DEG_TO_RAD
    stated_success = log.metadata.get("success")
    clipped = log.metadata.get("clipped_actions")
    row: dict[str, float | bool | None] = {
        "steps": float(log.num_steps),
        "duration_s": float(log.time[-1] - log.time[0]),
        "start_misalignment_deg": misalignment_deg(state[0, QUATERNION], port),
        "final_distance_m": float(np.linalg.norm(position[-1])),
        "final_speed_m_s": float(np.linalg.norm(velocity[-1])),
        "final_misalignment_deg": misalignment_deg(state[-1, QUATERNION], port),
        "final_rate_deg_s": float(np.linalg.norm(final_rate)),
        "final_closing_m_s": float(-port.axis_sign * velocity[-1, 1]),
        "closest_approach_m": closest_approach(position),
        "crossed": crossed,
        "crossing_time_s": crossing[0] if crossing else (float(log.time[-1]) if crossed else None),
        **{name: _contact_number(contact, name) if touched else None for name in CONTACT_NUMBERS},
        "success": bool(stated_success) if stated_success is not None else idss,
        "idss": idss,
        "atv": bool(contact["atv"]) and touched if "atv" in contact else None,
        "corridor_violated": bool(outside.any()),
        "corridor_share": float(outside.mean()),
        "fly_through": crossed and not met_box,
        **smoothness(log.action, log.dt, limits),
        **effort(log.action, log.dt, state[:, MASS], limits),
        "clipped_actions": float(clipped) if isinstance(clipped, int | float) else None,
        "reward_sum": float(log.reward.sum()),
        **inference(log),
    }
    ordered = {name: row[name] for name in NAMES}
    return ordered | {name: _flag(contact.get(name)) for name in (*IDSS_CONDITIONS, *ATV_CONDITIONS)}


def _check_clock(log: EpisodeLog) -> None:
    for name, steps in (("time", np.diff(log.time)), ("dt", log.dt)):
        back = np.flatnonzero(steps < 0.0)
        if back.size:
            raise InputError(name, f"a step of {steps[back[0]]:g} s in row {back[0]}", "steps of 0 s or more")


def _met_idss(at_plane: np.ndarray, port: Port, metadata: Mapping[str, Any]) -> bool:
    """Whether a fixed-horizon task's crossing of the plane lay in the box, which that task judges at its last state."""
    if ends_at_contact(metadata) or not isinstance(metadata.get("contact"), Mapping):
        return False  # the crossing is what was judged
    return bool(contact_report(contact_state(at_plane, port, hill_coupling=hill_coupled(metadata)))["idss"])


def _contact_number(contact: Mapping[str, Any], name: str) -> float:
    value = float(contact[name])
    return abs(value) if "roll" in name else value


def _flag(value: object) -> bool | None:
    return None if value is None else bool(value)
