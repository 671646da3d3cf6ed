"""Where episodes start, and what is drawn per episode: ranges with the reason for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.errors import InputError


@dataclass(frozen=True)
class InitialConditions:
    """A box of starts, uniform in each coordinate, in the axes of an approach from -V-bar (port at the origin).

    Attributes:
        position_m: (least, most) of x, y, z in Hill axes.
        velocity_m_s: (least, most) of vx, vy, vz.
        euler_deg: half range of each angle of an intrinsic x-y-z turn away from the nominal attitude.
        rate_deg_s: half range of each body rate.
    """

    position_m: tuple[tuple[float, float], ...]
    velocity_m_s: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 3
    euler_deg: float = 0.0
    rate_deg_s: float = 0.0

    def bounds(self) -> np.ndarray:
        """(2, 12): least and most of position, velocity, Euler angles (rad), rates (rad/s)."""
        pairs = [*self.position_m, *self.velocity_m_s]
        pairs += [(-np.deg2rad(half), np.deg2rad(half)) for half in (self.euler_deg, self.rate_deg_s) for _ in "xyz"]
        return np.array(pairs).T


_DISPERSED = {"velocity_m_s": ((-0.1, 0.1), (0.0, 0.2), (-0.1, 0.1)), "euler_deg": 1.0, "rate_deg_s": 0.1}
_SAME = ((-1.0, 1.0), (-26.0, -24.0), (-1.0, 1.0))

INITIAL_CONDITIONS = {
    # Table 2 of the paper, training set
    "same": InitialConditions(_SAME),
    # Table 2, with the velocities, angles and rates found in the published rollouts
    "random": InitialConditions(((-2.5, 2.5), (-27.5, -22.5), (-2.5, 2.5)), **_DISPERSED),
    # in the published rollouts only
    "same_dispersed": InitialConditions(_SAME, **_DISPERSED),
    # not in the paper: wider than every evaluation set, for demonstrations and for training the expert
    "wide": InitialConditions(
        ((-3.0, 3.0), (-28.0, -22.0), (-3.0, 3.0)), ((-0.15, 0.15), (-0.05, 0.25), (-0.15, 0.15)), 3.0, 0.3
    ),
}


def get_initial_conditions(name: str) -> InitialConditions:
    """The set of that name; raises InputError with the known names otherwise."""
    if name not in INITIAL_CONDITIONS:
        raise InputError("initial_conditions", name, " | ".join(INITIAL_CONDITIONS))
    return INITIAL_CONDITIONS[name]


@dataclass(frozen=True)
class MetaRanges:
    """The distribution of chasers and sensors of the meta-RL task; all drawn anew in each episode."""

    # ± fraction of 1000 kg: propellant load and cargo of a visiting vehicle are known to about that
    mass_fraction: float = 0.2
    # ± fraction of each principal moment: slosh and cargo placement move them more than the mass
    inertia_fraction: float = 0.2
    # ± kg·m², each product of inertia: about a hundredth of the moments
    inertia_product_kg_m2: float = 7.0
    # [least,most] in brackets: executed over commanded thrust, per axis; thrusters lose more than they gain
    thrust_scale: tuple[float, float] = (0.85, 1.05)
    # [least,most] in brackets: executed over commanded torque, per axis
    torque_scale: tuple[float, float] = (0.85, 1.05)
    # deg, standard deviation of the thrust frame's misalignment about each axis: mounting tolerance
    thrust_misalignment_deg: float = 1.0
    # ± N·m, each axis: plume impingement and residual atmosphere
    torque_bias_Nm: float = 0.1
    # ± m, each axis: centre of mass from the reference point, propellant moving it
    com_offset_m: float = 0.02
    # ± m, each axis: bias of the position sensor (mounting, target model)
    position_bias_m: float = 0.02
    # m, standard deviation of its noise at the port
    position_noise_m: float = 0.01
    # the same, as a fraction of the range
    position_noise_fraction: float = 0.001
    # ± m/s, each axis
    velocity_bias_m_s: float = 0.001
    # m/s, standard deviation
    velocity_noise_m_s: float = 0.003
    # ± deg, each axis: alignment of star tracker and docking axis
    attitude_bias_deg: float = 0.2
    # deg, standard deviation, each axis
    attitude_noise_deg: float = 0.1
    # ± deg/s, each axis: gyro bias
    rate_bias_deg_s: float = 0.01
    # deg/s, standard deviation
    rate_noise_deg_s: float = 0.01

    def packed(self) -> np.ndarray:
        """The kernels' layout, SI and radians, (19,) float64: see ``scenario.draw_chaser`` and ``draw_sensor``."""
        return np.array(
            [
                self.mass_fraction,
                self.inertia_fraction,
                self.inertia_product_kg_m2,
                *self.thrust_scale,
                *self.torque_scale,
                np.deg2rad(self.thrust_misalignment_deg),
                self.torque_bias_Nm,
                self.com_offset_m,
                self.position_bias_m,
                self.velocity_bias_m_s,
                np.deg2rad(self.attitude_bias_deg),
                np.deg2rad(self.rate_bias_deg_s),
                self.position_noise_m,
                self.velocity_noise_m_s,
                np.deg2rad(self.attitude_noise_deg),
                np.deg2rad(self.rate_noise_deg_s),
                self.position_noise_fraction,
            ]
        )
