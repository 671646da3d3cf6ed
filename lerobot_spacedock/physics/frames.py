"""Conventions, on one page: frames, axes, quaternion order, signs, and the layout of state and action.

Hill frame H
    Origin at the docking port. ``x`` radial outward, to zenith (−R-bar), ``y`` along-track (+velocity, +V-bar),
    ``z`` orbit normal. The station stands still in H. In LVLH axes with x along V-bar and z to nadir the same vector
    is ``(y, -z, -x)``.

Body frame B
    Origin at the chaser's reference point (the tip that docks), where the camera sits and looks along ``+z_B``.
    Image columns run along ``+y_B`` (right in the picture), image rows along ``-x_B`` (down in the picture): at the
    nominal attitude ``q_HB = (√½, -√½, 0, 0)`` the camera looks along ``+y_H``, zenith is up and Earth below.

Station axes S (as the measured port coordinates are given)
    ``-y_S`` forward, ``+z_S`` zenith: ``x_S = z_H``, ``y_S = -y_H``, ``z_S = x_H``.

Quaternion
    Scalar first, ``q = (q0, q1, q2, q3)``, unit norm; ``q_HB`` turns body vectors into Hill vectors:
    ``v_H = q_HB ⊗ (0, v_B) ⊗ q_HB*``. ``q`` and ``-q`` are the same attitude.

Angular velocity
    ``omega_BH_B``: of the body, expressed in body axes, rad/s inside, deg/s at the observation's edge only. Where
    Hill coupling is on, the state holds the inertial rate ``omega_BI_B``.

State vector, 14 values (the order of the authors' published dataset)
    ``x, y, z [m], vx, vy, vz [m/s] (H), mass [kg], q0, q1, q2, q3, w1, w2, w3 [rad/s inside] (B)``.

Action, 6 values
    thrust ``Tx, Ty, Tz [N]`` and torque ``Lx, Ly, Lz [N·m]``, both in body axes, held over the step.
"""

from __future__ import annotations

import numpy as np

STATE_NAMES = ("x", "y", "z", "vx", "vy", "vz", "mass", "q0", "q1", "q2", "q3", "w1", "w2", "w3")
ACTION_NAMES = ("Tx", "Ty", "Tz", "Lx", "Ly", "Lz")
STATE_DIM = len(STATE_NAMES)
ACTION_DIM = len(ACTION_NAMES)

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
MASS = 6
QUATERNION = slice(7, 11)
RATE = slice(11, 14)


def observed_indices(*, with_mass: bool = False, withhold_pose: bool = False) -> np.ndarray:
    """Which values of the state make ``observation.state``: 13; one more with the mass, 7 fewer without the pose."""
    left_out = {"x", "y", "z", "q0", "q1", "q2", "q3"} if withhold_pose else set()
    left_out |= set() if with_mass else {"mass"}
    return np.array([i for i, name in enumerate(STATE_NAMES) if name not in left_out])


# observation.state as most tasks have it: 13 values
OBSERVATION_INDICES = observed_indices()
OBSERVATION_NAMES = tuple(STATE_NAMES[i] for i in OBSERVATION_INDICES)

RAD_TO_DEG = 180.0 / np.pi
DEG_TO_RAD = np.pi / 180.0


def state_to_dataset_units(state: np.ndarray) -> np.ndarray:
    """SI state(s) with rad/s → the dataset's units, with deg/s. (..., 14) → (..., 14), a copy."""
    out = np.array(state, dtype=np.float64)
    out[..., RATE] *= RAD_TO_DEG
    return out


def state_from_dataset_units(state: np.ndarray) -> np.ndarray:
    """The dataset's state(s), with deg/s → SI with rad/s. (..., 14) → (..., 14), a copy."""
    out = np.array(state, dtype=np.float64)
    out[..., RATE] *= DEG_TO_RAD
    return out
