"""What the classical experts share: translation by a law of their own, attitude by quaternion PD, then body thrust."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.expert.policy import ACTION_LIMITS, action_signs, check_observation, observation_signs
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.constants import CHASER_INERTIA_kg_m2, CHASER_MASS_kg, MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port
from lerobot_spacedock.physics.frames import DEG_TO_RAD

ATTITUDE_FREQUENCY_rad_s = 0.15
ATTITUDE_DAMPING = 1.0


def hill_acceleration(r: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Free acceleration in the Hill frame (HCW), m/s². (N, 3), (N, 3) → (N, 3)."""
    n = MEAN_MOTION_rad_s
    return np.stack([3.0 * n**2 * r[:, 0] + 2.0 * n * v[:, 1], -2.0 * n * v[:, 0], -(n**2) * r[:, 2]], axis=1)


def attitude_torque(
    q_HB: np.ndarray,
    omega_B: np.ndarray,
    q_nominal: np.ndarray,
    *,
    hill_coupling: bool,
    frequency_rad_s: float = ATTITUDE_FREQUENCY_rad_s,
    damping: float = ATTITUDE_DAMPING,
) -> np.ndarray:
    """Quaternion PD towards the docking attitude, for the nominal inertia.

    Args:
        q_HB: (N, 4).
        omega_B: rad/s, (N, 3), body axes; the inertial rate where ``hill_coupling``.
        q_nominal: (4,).
        hill_coupling: the station turns once an orbit: that rate is the one to hold.
        frequency_rad_s: of the closed loop.
        damping: of the closed loop, 1 is critical.

    Returns:
        N·m, (N, 3), body axes.

    Source: Wie, Weiss and Arapostathis, "Quaternion feedback regulator for spacecraft eigenaxis rotations", J. Guid.
    Control Dyn. 12 (1989), without the gyroscopic term (it vanishes for the nominal inertia).
    """
    error = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(q_nominal), q_HB))
    if hill_coupling:
        omega_B = omega_B - rotations.rotate_inverse(q_HB, np.array([0.0, 0.0, MEAN_MOTION_rad_s]))
    return -CHASER_INERTIA_kg_m2 * (frequency_rad_s**2 * error + 2.0 * damping * frequency_rad_s * omega_B)


class ClassicalPolicy:
    """A guidance law for the nominal chaser; subclasses give ``acceleration``.

    Args:
        port: where to dock.
        hill_coupling: the attitude model flown in: True where rates are inertial (the contact ids).
    """

    def __init__(self, *, port: Port = ZVEZDA_AFT, hill_coupling: bool = False) -> None:
        self._to_aft, self._from_aft = observation_signs(port), action_signs(port)
        self._hill_coupling = hill_coupling
        self._count = 0
        self.step = 0

    def reset(self, count: int) -> None:
        """Starts ``count`` episodes."""
        self._count, self.step = count, 0

    def act(self, observation: np.ndarray) -> np.ndarray:
        """(N, 13) ``observation.state`` → (N, 6) N and N·m, body axes, within the limits."""
        seen = check_observation(observation, self._count) * self._to_aft
        r, v, q, omega = seen[:, 0:3], seen[:, 3:6], rotations.normalize(seen[:, 6:10]), seen[:, 10:13] * DEG_TO_RAD
        force = CHASER_MASS_kg * rotations.rotate_inverse(q, self.acceleration(r, v))
        q_nominal = np.array(ZVEZDA_AFT.q_nominal)
        torque = attitude_torque(q, omega, q_nominal, hill_coupling=self._hill_coupling)
        self.step += 1
        command = np.concatenate([force, torque], axis=1)
        return np.clip(command, -ACTION_LIMITS, ACTION_LIMITS) * self._from_aft

    def acceleration(self, r: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Commanded acceleration, m/s², Hill axes of the approach from -V-bar. (N, 3), (N, 3) → (N, 3)."""
        raise NotImplementedError
