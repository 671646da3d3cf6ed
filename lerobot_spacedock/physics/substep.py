"""One substep of a chaser's motion under a held wrench, as scalar arithmetic without a branch.

Without a branch, so that the compiler can fly several chasers in one vector register (``propagate.py``); and one
function for the lone chaser and the lane of a block, so that the two agree to the bit.
"""

from __future__ import annotations

from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics.relative_motion import hcw_transition_row
from lerobot_spacedock.physics.rigid_body import (
    axpy,
    cross,
    follow_rates,
    general_rates,
    isotropic_rates,
    multiply_matrix,
    rotate_vector,
    scaled,
)


@jit(forceinline=True)
def turned_frame(q, cosine, sine):
    """The attitude ``q`` as seen from a frame that has turned about +z by the angle of (``cosine``, ``sine``) / 2."""
    return (
        cosine * q[0] + sine * q[3],
        cosine * q[1] + sine * q[2],
        cosine * q[2] - sine * q[1],
        cosine * q[3] - sine * q[0],
    )


@jit(forceinline=True)
def translate(r, v, starts, middles, ends, h, n, per_n, quarter, half):
    """HCW over ``h``: the exact transition of the start, and Simpson's rule over the thrust's acceleration.

    Args:
        r, v: 3-tuples, m and m/s, Hill axes.
        starts, middles, ends: 3-tuples, m/s², acceleration at the three nodes.
        h: s. n: mean motion, rad/s; per_n: its inverse.
        quarter, half: (sine, cosine) of ``n h / 4`` and ``n h / 2``.
    """
    sixth = h * (1 / 6)
    r, v = hcw_transition_row(r, axpy(sixth, starts, v), n, per_n, half[0], half[1], h)
    r_middle, v_middle = hcw_transition_row((0.0, 0.0, 0.0), middles, n, per_n, quarter[0], quarter[1], 0.5 * h)
    r = axpy(4.0 * sixth, r_middle, r)
    v = axpy(4.0 * sixth, v_middle, v)
    return r, axpy(sixth, ends, v)


@jit(forceinline=True)
def substep(r, v, mass, q, omega, thrust, flow, first, second, h, n, per_n, quarter, half, frame):
    """One substep: turned in two halves, moved under the thrust as it stands at start, middle and end.

    Args:
        r, v, mass, q, omega: the state, tuples, SI; of the centre of mass.
        thrust: N, 3-tuple, body axes, executed.
        flow: kg/s, negative.
        first, second: rates in the middle and at the end of each half, as from ``halves_isotropic``.
        frame: (cosine, sine) of half the angle by which the attitude's frame turns in ``h / 2``; the rest as
            ``translate``'s.

    Returns:
        (r, v, mass, q, omega) after ``h``.
    """
    starts = rotate_vector(q, scaled(1.0 / mass, thrust))
    q = turned_frame(follow_rates(q, omega, first[0], first[1], 0.5 * h), frame[0], frame[1])
    middles = rotate_vector(q, scaled(1.0 / (mass + 0.5 * h * flow), thrust))
    q = turned_frame(follow_rates(q, first[1], second[0], second[1], 0.5 * h), frame[0], frame[1])
    mass = mass + h * flow
    ends = rotate_vector(q, scaled(1.0 / mass, thrust))
    r, v = translate(r, v, starts, middles, ends, h, n, per_n, quarter, half)
    return r, v, mass, q, second[1]


@jit(forceinline=True)
def halves_isotropic(omega, acceleration, h):
    """Rates in the two halves of ``h``, the inertia a multiple of the identity; acceleration: torque over it."""
    first = isotropic_rates(omega, acceleration, 0.5 * h)
    return first, isotropic_rates(first[1], acceleration, 0.5 * h)


@jit(forceinline=True)
def halves_general(omega, torque, inertia, inverse, h):
    """Rates in the two halves of ``h`` with any inertia (9-tuples, row-major, kg·m² and its inverse)."""
    first = general_rates(omega, torque, 0.5 * h, inertia, inverse)
    return first, general_rates(first[1], torque, 0.5 * h, inertia, inverse)


@jit(forceinline=True)
def shift_point(r, v, q, omega, offset, sign, frame_rate):
    """Position and velocity (Hill axes) of the point at ``sign * offset`` (body axes) from the given one.

    ``frame_rate``: rad/s about +z, of the frame in which ``q`` and ``v`` are given.
    """
    arm = rotate_vector(q, offset)
    turning = rotate_vector((q[0], -q[1], -q[2], -q[3]), (0.0, 0.0, frame_rate))
    swing = rotate_vector(q, cross(axpy(-1.0, turning, omega), offset))
    return axpy(sign, arm, r), axpy(sign, swing, v)


@jit(forceinline=True)
def executed(action, thrust_map, torque_map, torque_bias):
    """Thrust (N) and torque (N·m) that the actuators make of a command, 3-tuples, body axes."""
    thrust = multiply_matrix(thrust_map, (action[0], action[1], action[2]))
    torque = multiply_matrix(torque_map, (action[3], action[4], action[5]))
    return thrust, axpy(1.0, torque, torque_bias)
