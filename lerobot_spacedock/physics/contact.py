"""Ports, the state at contact, and the boxes it has to lie in. Success is defined here, once.

The docking axis leaves the port along its outward normal; ``axial`` is the distance along it (positive outside),
``lateral`` the distance from it. Contact is the instant at which the chaser's reference point reaches the port plane
(axial = 0).

Sources: International Docking System Standard (initial contact conditions; internationaldockingstandard.com), and the
ATV's probe-and-drogue envelope at Zvezda; the numbers as listed with the reference environment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.frames import DEG_TO_RAD, POSITION, QUATERNION, RATE, VELOCITY


@dataclass(frozen=True)
class Port:
    """A docking port at the origin of the Hill frame.

    Attributes:
        name: as in ``--env.port``.
        axis_sign: the outward normal is ``(0, axis_sign, 0)`` in Hill axes: -1 faces -V-bar, +1 faces +V-bar.
        q_nominal: (4,) attitude of a chaser that looks straight into the port, zenith up in its picture.
        capture_radius_m: lateral distance within which the reference point meets the port's own hardware.
        station_radius_m: lateral distance within which there is station structure behind the port plane.
    """

    name: str
    axis_sign: float
    q_nominal: tuple[float, float, float, float]
    capture_radius_m: float
    station_radius_m: float

    @property
    def mirror(self) -> np.ndarray:
        """(3,) signs of the half turn about the radial axis that carries a -V-bar approach to this port's."""
        return np.array([1.0, -self.axis_sign, -self.axis_sign])


_HALF_SQRT = np.sqrt(0.5)
# 0.6 m: IDSS ring and drogue cone alike; modules of 4.2 m (Zvezda) and 4.4 m (Harmony) across, plus half a chaser
ZVEZDA_AFT = Port("zvezda_aft", -1.0, (_HALF_SQRT, -_HALF_SQRT, 0.0, 0.0), 0.6, 2.1 + 1.0)
# half a turn about body x, then q_nominal of Zvezda: looks along -y_H, zenith up
HARMONY_FORWARD = Port("harmony_forward", 1.0, (_HALF_SQRT, _HALF_SQRT, 0.0, 0.0), 0.6, 2.2 + 1.0)
PORTS = {port.name: port for port in (ZVEZDA_AFT, HARMONY_FORWARD)}


def get_port(name: str) -> Port:
    """The port of that name; raises InputError with the known names otherwise."""
    if name not in PORTS:
        raise InputError("port", name, " | ".join(PORTS))
    return PORTS[name]


@dataclass(frozen=True)
class ContactBox:
    """Limits on the state at contact; a condition holds on the limit itself.

    Attributes:
        closing_speed_m_s: (least, most) speed along the docking axis, into the port.
        lateral_m: most lateral misalignment.
        lateral_speed_m_s: most speed across the docking axis; None, here and below: not limited in this box.
        pitch_yaw_deg: most angle between the two docking axes.
        roll_deg: most rotation about the docking axis.
        pitch_yaw_rate_deg_s: most angular rate across the docking axis, relative to the station.
        roll_rate_deg_s: most angular rate about it.
    """

    closing_speed_m_s: tuple[float, float]
    lateral_m: float
    lateral_speed_m_s: float | None
    pitch_yaw_deg: float | None
    roll_deg: float | None
    pitch_yaw_rate_deg_s: float | None
    roll_rate_deg_s: float | None


IDSS = ContactBox((0.05, 0.10), 0.10, 0.04, 4.0, 4.0, 0.20, 0.20)
ATV = ContactBox((0.05, 0.10), 0.10, None, None, None, None, None)
BOXES = {"idss": IDSS, "atv": ATV}


def relative_rate(
    state: np.ndarray, *, hill_coupling: bool, mean_motion_rad_s: float = MEAN_MOTION_rad_s
) -> np.ndarray:
    """Angular velocity of the chaser against the station, body axes. SI states (..., 14) → rad/s, (..., 3).

    Args:
        state: SI with rad/s, (..., 14).
        hill_coupling: the state's rates are inertial and the station turns with the Hill frame; False: it does not.
        mean_motion_rad_s: rad/s, of that turning.
    """
    omega = state[..., RATE]
    if not hill_coupling:
        return omega
    return omega - rotations.rotate_inverse(state[..., QUATERNION], np.array([0.0, 0.0, mean_motion_rad_s]))


def contact_state(
    state: np.ndarray,
    port: Port = ZVEZDA_AFT,
    *,
    hill_coupling: bool,
    mean_motion_rad_s: float = MEAN_MOTION_rad_s,
) -> dict[str, np.ndarray]:
    """What a docking standard asks of a state, over a batch.

    Args:
        state: SI with rad/s, (..., 14), in the order of ``frames.STATE_NAMES``.
        port: the port whose axis is meant.
        hill_coupling: the state's rates are inertial and the station turns with the Hill frame; False: it does not.
        mean_motion_rad_s: rad/s, of that turning.

    Returns:
        (...) arrays: ``axial_m`` (positive outside), ``closing_speed_m_s``, ``lateral_m``, ``lateral_speed_m_s``,
        ``pitch_yaw_deg``, ``roll_deg`` (signed), ``pitch_yaw_rate_deg_s``, ``roll_rate_deg_s`` (signed).
    """
    state = np.asarray(state, dtype=np.float64)
    r, v, q_HB = (state[..., part] for part in (POSITION, VELOCITY, QUATERNION))
    omega = relative_rate(state, hill_coupling=hill_coupling, mean_motion_rad_s=mean_motion_rad_s)
    # error of attitude, body axes of the nominal attitude: swing away from the docking axis, twist about it
    error = rotations.multiply(rotations.conjugate(np.array(port.q_nominal)), q_HB)
    swing = 2.0 * np.arctan2(np.hypot(error[..., 1], error[..., 2]), np.hypot(error[..., 0], error[..., 3]))
    twist = 2.0 * np.arctan2(error[..., 3], error[..., 0])
    twist = (twist + np.pi) % (2.0 * np.pi) - np.pi
    return {
        "axial_m": port.axis_sign * r[..., 1],
        "closing_speed_m_s": -port.axis_sign * v[..., 1],
        "lateral_m": np.hypot(r[..., 0], r[..., 2]),
        "lateral_speed_m_s": np.hypot(v[..., 0], v[..., 2]),
        "pitch_yaw_deg": swing / DEG_TO_RAD,
        "roll_deg": twist / DEG_TO_RAD,
        "pitch_yaw_rate_deg_s": np.hypot(omega[..., 0], omega[..., 1]) / DEG_TO_RAD,
        "roll_rate_deg_s": omega[..., 2] / DEG_TO_RAD,
    }


def box_conditions(contact: dict[str, np.ndarray], box: ContactBox) -> dict[str, np.ndarray]:
    """Each condition of a box, pass or fail, for states as ``contact_state`` gives them; keys without unit."""
    least, most = box.closing_speed_m_s
    speed = np.asarray(contact["closing_speed_m_s"])
    conditions = {"closing_speed": (speed >= least) & (speed <= most)}
    for name in (
        "lateral_m",
        "lateral_speed_m_s",
        "pitch_yaw_deg",
        "roll_deg",
        "pitch_yaw_rate_deg_s",
        "roll_rate_deg_s",
    ):
        limit = getattr(box, name)
        if limit is not None:
            conditions[_without_unit(name)] = np.abs(contact[name]) <= limit
    return conditions


def contact_report(contact: dict[str, np.ndarray], *, at_plane: bool | np.ndarray = True) -> dict[str, np.ndarray]:
    """``contact`` with every condition of every box beside it (``idss_lateral``, …) and all together (``idss``).

    Args:
        contact: as from ``contact_state``.
        at_plane: whether the states stand on the port plane, one for all or (...). Where not (the paper's fixed-horizon
            task, an episode that ran out of time), the misalignment that the boxes limit is the whole distance to the
            port, axial included.
    """
    distance = np.hypot(contact["lateral_m"], contact["axial_m"])
    judged = contact | {"lateral_m": np.where(at_plane, contact["lateral_m"], distance)}
    report = dict(contact)
    for label, box in BOXES.items():
        conditions = box_conditions(judged, box)
        report |= {f"{label}_{name}": passed for name, passed in conditions.items()}
        report[label] = np.logical_and.reduce(list(conditions.values()))
    return report


def _without_unit(name: str) -> str:
    for unit in ("_deg_s", "_m_s", "_deg", "_m"):
        if name.endswith(unit):
            return name.removesuffix(unit)
    return name
