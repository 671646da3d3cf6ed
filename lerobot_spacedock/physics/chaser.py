"""The chaser: mass properties and actuators, for one or for a batch, packed for the kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics import constants as c

# columns of the packed parameter array
INERTIA = 0  # 9, kg·m², about the centre of mass, body axes
INERTIA_INVERSE = 9  # 9
THRUST_MAP = 18  # 9, commanded → executed thrust
TORQUE_MAP = 27  # 9, commanded → executed torque
TORQUE_BIAS = 36  # 3, N·m, constant, body axes
COM_OFFSET = 39  # 3, m, centre of mass as seen from the reference point, body axes
EXHAUST_SPEED = 42  # 1, m/s, Isp·g0
SIMPLE = 43  # 1, 1.0 where J is a multiple of the identity and the centre of mass is the reference point
PARAMETER_DIM = 44


@dataclass(frozen=True)
class ChaserParameters:
    """What the dynamics need to know of ``N`` chasers beside their state (the mass is in the state).

    Attributes:
        inertia_kg_m2: (N, 3, 3), symmetric, positive definite, about the centre of mass.
        thrust_map: (N, 3, 3), executed thrust = map @ commanded thrust (scale and misalignment).
        torque_map: (N, 3, 3), the same for torque.
        torque_bias_Nm: (N, 3), constant disturbance torque, body axes.
        com_offset_m: (N, 3), centre of mass relative to the reference point, body axes. Thrust acts through the
            reference point, so an offset ``d`` adds the torque ``-d × T``.
        specific_impulse_s: (N,).
    """

    inertia_kg_m2: np.ndarray
    thrust_map: np.ndarray
    torque_map: np.ndarray
    torque_bias_Nm: np.ndarray
    com_offset_m: np.ndarray
    specific_impulse_s: np.ndarray

    @classmethod
    def nominal(cls, count: int = 1) -> ChaserParameters:
        """The reference chaser: a uniform cube with perfect actuators (REFERENCE rollouts), ``count`` times."""
        eye = np.tile(np.eye(3), (count, 1, 1))
        return cls(
            inertia_kg_m2=c.CHASER_INERTIA_kg_m2 * eye,
            thrust_map=eye.copy(),
            torque_map=eye.copy(),
            torque_bias_Nm=np.zeros((count, 3)),
            com_offset_m=np.zeros((count, 3)),
            specific_impulse_s=np.full(count, c.SPECIFIC_IMPULSE_s),
        )

    def pack(self) -> np.ndarray:
        """The kernels' layout, (N, PARAMETER_DIM) float64.

        Raises:
            InputError: an inertia that is not symmetric and positive definite, or a value that is not finite.
        """
        inertia = np.asarray(self.inertia_kg_m2, dtype=np.float64)
        packed = np.empty((len(inertia), PARAMETER_DIM))
        packed[:, INERTIA : INERTIA + 9] = inertia.reshape(-1, 9)
        packed[:, THRUST_MAP : THRUST_MAP + 9] = np.reshape(self.thrust_map, (-1, 9))
        packed[:, TORQUE_MAP : TORQUE_MAP + 9] = np.reshape(self.torque_map, (-1, 9))
        packed[:, TORQUE_BIAS : TORQUE_BIAS + 3] = self.torque_bias_Nm
        packed[:, COM_OFFSET : COM_OFFSET + 3] = self.com_offset_m
        packed[:, EXHAUST_SPEED] = np.asarray(self.specific_impulse_s) * c.STANDARD_GRAVITY_m_s2
        symmetric = np.allclose(inertia, np.swapaxes(inertia, 1, 2), rtol=1e-12, atol=0.0)
        if not (np.isfinite(inertia).all() and symmetric and (np.linalg.eigvalsh(inertia) > 0.0).all()):
            raise InputError("inertia_kg_m2", inertia, "symmetric positive definite 3×3 matrices in kg·m², all finite")
        packed[:, INERTIA_INVERSE : INERTIA_INVERSE + 9] = np.linalg.inv(inertia).reshape(-1, 9)
        isotropic = (inertia == inertia[:, :1, :1] * np.eye(3)).all(axis=(1, 2))
        packed[:, SIMPLE] = isotropic & (packed[:, COM_OFFSET : COM_OFFSET + 3] == 0.0).all(axis=1)
        if not (np.isfinite(packed).all() and (packed[:, EXHAUST_SPEED] > 0.0).all()):
            raise InputError("chaser parameters", "a value that is not finite or an Isp ≤ 0", "finite, Isp > 0")
        return packed
