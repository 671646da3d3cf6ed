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


@jit(inline="always")
def cross(a, b):
    """Cross product of two 3-tuples."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@jit(inline="always")
def axpy(scale, a, b):
    """``scale * a + b`` of two 3-tuples."""
    return (scale * a[0] + b[0], scale * a[1] + b[1], scale * a[2] + b[2])


@jit(inline="always")
def scaled(scale, a):
    """``scale * a`` of a 3-tuple."""
    return (scale * a[0], scale * a[1], scale * a[2])


@jit(inline="always")
def multiply_quaternions(p, q):
    """Hamilton product of two 4-tuples, scalar first."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@jit(inline="always")
def rotate_vector(q, v):
    """``q ⊗ (0, v) ⊗ q*``: body vector in the outer frame, 3-tuple."""
    vector = (q[1], q[2], q[3])
    t = cross(vector, v)
    t = (2.0 * t[0], 2.0 * t[1], 2.0 * t[2])
    u = cross(vector, t)
    return (v[0] + q[0] * t[0] + u[0], v[1] + q[0] * t[1] + u[1], v[2] + q[0] * t[2] + u[2])


@jit(inline="always")
def rotate_vector_inverse(q, v):
    """Outer vector in body axes, 3-tuple."""
    return rotate_vector((q[0], -q[1], -q[2], -q[3]), v)


@jit(inline="always")
def rotation_vector_to_quaternion(phi):
    """Exponential of a rotation vector below about 1 rad, by its Taylor series (error < 1e-15 there)."""
    x = 0.25 * (phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    cosine = 1.0 - x / 2.0 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0))))
    sinc = 1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0))))
    return (cosine, 0.5 * sinc * phi[0], 0.5 * sinc * phi[1], 0.5 * sinc * phi[2])


@jit(inline="always")
def multiply_matrix(matrices, row, first, v):
    """``A v`` with the 3×3 matrix that stands row-major at ``matrices[row, first : first + 9]``."""
    m = matrices
    return (
        m[row, first] * v[0] + m[row, first + 1] * v[1] + m[row, first + 2] * v[2],
        m[row, first + 3] * v[0] + m[row, first + 4] * v[1] + m[row, first + 5] * v[2],
        m[row, first + 6] * v[0] + m[row, first + 7] * v[1] + m[row, first + 8] * v[2],
    )


@jit(inline="always")
def angular_acceleration(omega, torque, matrices, row, inertia_at, inverse_at):
    """Euler's equations solved for ω̇, rad/s², 3-tuple, body axes."""
    gyroscopic = cross(omega, multiply_matrix(matrices, row, inertia_at, omega))
    return multiply_matrix(matrices, row, inverse_at, axpy(-1.0, gyroscopic, torque))


@jit(inline="always")
def advance_attitude(q, omega, torque, step_s, isotropic, matrices, row, inertia_at, inverse_at):
    """One step of rotation under constant body torque.

    Args:
        q: 4-tuple, scalar first, body to inertial.
        omega: rad/s, 3-tuple, body axes, inertial rate.
        torque: N·m, 3-tuple, body axes, constant over the step.
        step_s: s.
        isotropic: the inertia is a multiple of the identity: no gyroscopic torque, ω linear in time.
        matrices: (N, M) packed parameters; ``row``, ``inertia_at`` and ``inverse_at`` say where J and J⁻¹ stand.

    Returns:
        (q, omega) after the step.
    """
    if isotropic:
        start = multiply_matrix(matrices, row, inverse_at, torque)
        middle = axpy(0.5 * step_s, start, omega)
        end = axpy(step_s, start, omega)
    else:
        start = angular_acceleration(omega, torque, matrices, row, inertia_at, inverse_at)
        k2 = angular_acceleration(axpy(0.5 * step_s, start, omega), torque, matrices, row, inertia_at, inverse_at)
        k3 = angular_acceleration(axpy(0.5 * step_s, k2, omega), torque, matrices, row, inertia_at, inverse_at)
        k4 = angular_acceleration(axpy(step_s, k3, omega), torque, matrices, row, inertia_at, inverse_at)
        end = (
            omega[0] + step_s / 6.0 * (start[0] + 2.0 * (k2[0] + k3[0]) + k4[0]),
            omega[1] + step_s / 6.0 * (start[1] + 2.0 * (k2[1] + k3[1]) + k4[1]),
            omega[2] + step_s / 6.0 * (start[2] + 2.0 * (k2[2] + k3[2]) + k4[2]),
        )
        finish = angular_acceleration(end, torque, matrices, row, inertia_at, inverse_at)
        # cubic Hermite value at the middle: order 4, no further evaluation
        middle = (
            0.5 * (omega[0] + end[0]) + step_s / 8.0 * (start[0] - finish[0]),
            0.5 * (omega[1] + end[1]) + step_s / 8.0 * (start[1] - finish[1]),
            0.5 * (omega[2] + end[2]) + step_s / 8.0 * (start[2] - finish[2]),
        )
    commutator = cross(omega, end)
    sixth, twelfth = step_s / 6.0, step_s * step_s / 12.0
    phi = (
        sixth * (omega[0] + 4.0 * middle[0] + end[0]) + twelfth * commutator[0],
        sixth * (omega[1] + 4.0 * middle[1] + end[1]) + twelfth * commutator[1],
        sixth * (omega[2] + 4.0 * middle[2] + end[2]) + twelfth * commutator[2],
    )
    q = multiply_quaternions(q, rotation_vector_to_quaternion(phi))
    # one Newton step towards unit norm: removes rounding drift, leaves the direction
    scale = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (scale * q[0], scale * q[1], scale * q[2], scale * q[3]), end
