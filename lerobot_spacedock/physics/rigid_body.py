"""Rigid-body rotation over a step of constant body torque: Euler's equations and the attitude that follows.

    ω̇ = J⁻¹(τ − ω × Jω),   q̇ = ½ q ⊗ (0, ω)

Rates: classical Runge–Kutta of order 4; exact where the inertia is a multiple of the identity, since ω is then
linear in time. Attitude: Magnus expansion of order 4 with Simpson nodes, whose exponential is a rotation, so the
norm is kept by construction; exact about a fixed axis.

Source: Blanes, Casas, Oteo and Ros, "The Magnus expansion and some of its applications", Physics Reports 470
(2009), sec. 5.4; the commutator's sign is that of right multiplication (body rates).
"""

from __future__ import annotations

from lerobot_spacedock.jit import jit


@jit(forceinline=True)
def cross(a, b):
    """Cross product of two 3-tuples."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@jit(forceinline=True)
def axpy(scale, a, b):
    """``scale * a + b`` of two 3-tuples."""
    return (scale * a[0] + b[0], scale * a[1] + b[1], scale * a[2] + b[2])


@jit(forceinline=True)
def scaled(scale, a):
    """``scale * a`` of a 3-tuple."""
    return (scale * a[0], scale * a[1], scale * a[2])


@jit(forceinline=True)
def multiply_quaternions(p, q):
    """Hamilton product of two 4-tuples, scalar first."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@jit(forceinline=True)
def rotate_vector(q, v):
    """``q ⊗ (0, v) ⊗ q*``: body vector in the outer frame, 3-tuple."""
    vector = (q[1], q[2], q[3])
    t = cross(vector, v)
    t = (2.0 * t[0], 2.0 * t[1], 2.0 * t[2])
    u = cross(vector, t)
    return (v[0] + q[0] * t[0] + u[0], v[1] + q[0] * t[1] + u[1], v[2] + q[0] * t[2] + u[2])


@jit(forceinline=True)
def rotate_vector_inverse(q, v):
    """Outer vector in body axes, 3-tuple."""
    return rotate_vector((q[0], -q[1], -q[2], -q[3]), v)


@jit(forceinline=True)
def rotation_vector_to_quaternion(phi):
    """Exponential of a rotation vector below about 1 rad, by its Taylor series (error < 1e-15 there)."""
    x = 0.25 * (phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    cosine = 1.0 - x * (1 / 2 - x * (1 / 24 - x * (1 / 720 - x * (1 / 40320 - x * (1 / 3628800)))))
    sinc = 1.0 - x * (1 / 6 - x * (1 / 120 - x * (1 / 5040 - x * (1 / 362880 - x * (1 / 39916800)))))
    return (cosine, 0.5 * sinc * phi[0], 0.5 * sinc * phi[1], 0.5 * sinc * phi[2])


@jit(forceinline=True)
def multiply_matrix(m, v):
    """``m v`` of a 3×3 matrix, 9-tuple, row-major, and a 3-tuple."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@jit(forceinline=True)
def angular_acceleration(omega, torque, inertia, inverse):
    """Euler's equations solved for ω̇, rad/s², 3-tuple, body axes; matrices as 9-tuples, row-major."""
    gyroscopic = cross(omega, multiply_matrix(inertia, omega))
    return multiply_matrix(inverse, axpy(-1.0, gyroscopic, torque))


@jit(forceinline=True)
def isotropic_rates(omega, acceleration, step_s):
    """Rates in the middle and at the end of a step where the inertia is a multiple of the identity: ω is linear."""
    return axpy(0.5 * step_s, acceleration, omega), axpy(step_s, acceleration, omega)


@jit(forceinline=True)
def general_rates(omega, torque, step_s, inertia, inverse):
    """Rates in the middle and at the end of a step under constant body torque, 3-tuples, rad/s, body axes."""
    start = angular_acceleration(omega, torque, inertia, inverse)
    k2 = angular_acceleration(axpy(0.5 * step_s, start, omega), torque, inertia, inverse)
    k3 = angular_acceleration(axpy(0.5 * step_s, k2, omega), torque, inertia, inverse)
    k4 = angular_acceleration(axpy(step_s, k3, omega), torque, inertia, inverse)
    sixth, eighth = step_s * (1 / 6), step_s * 0.125
    end = (
        omega[0] + sixth * (start[0] + 2.0 * (k2[0] + k3[0]) + k4[0]),
        omega[1] + sixth * (start[1] + 2.0 * (k2[1] + k3[1]) + k4[1]),
        omega[2] + sixth * (start[2] + 2.0 * (k2[2] + k3[2]) + k4[2]),
    )
    finish = angular_acceleration(end, torque, inertia, inverse)
    # cubic Hermite value at the middle: order 4, no further evaluation
    middle = (
        0.5 * (omega[0] + end[0]) + eighth * (start[0] - finish[0]),
        0.5 * (omega[1] + end[1]) + eighth * (start[1] - finish[1]),
        0.5 * (omega[2] + end[2]) + eighth * (start[2] - finish[2]),
    )
    return middle, end


@jit(forceinline=True)
def follow_rates(q, omega, middle, end, step_s):
    """The attitude after a step in which the body rate goes from ``omega`` over ``middle`` to ``end``.

    Args:
        q: 4-tuple, scalar first, body to inertial.
        omega, middle, end: rad/s, 3-tuples, body axes, inertial rates.
        step_s: s.

    Returns:
        4-tuple, of unit norm to rounding if ``q`` was.
    """
    commutator = cross(omega, end)
    sixth, twelfth = step_s * (1 / 6), step_s * step_s * (1 / 12)
    phi = (
        sixth * (omega[0] + 4.0 * middle[0] + end[0]) + twelfth * commutator[0],
        sixth * (omega[1] + 4.0 * middle[1] + end[1]) + twelfth * commutator[1],
        sixth * (omega[2] + 4.0 * middle[2] + end[2]) + twelfth * commutator[2],
    )
    q = multiply_quaternions(q, rotation_vector_to_quaternion(phi))
    # one Newton step towards unit norm: removes rounding drift, leaves the direction
    scale = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (scale * q[0], scale * q[1], scale * q[2], scale * q[3])
