"""One chaser or a batch, over a step of held command: HCW translation under a thrust that turns with the body.

Method, per substep ``h``: the attitude by two half steps (``rigid_body.py``); the translation by the exact HCW
transition of its start, plus the thrust's integral by Simpson's rule over start, middle and end, each carried to the
end by the exact transition; the mass linear in time, as a constant flow makes it. Order 4 in ``h``; exact for a
thrust that keeps its direction at constant mass, to rounding. Substeps are as many as keep the turn in each below
``SUBSTEP_ANGLE_rad``: one, in any sane docking.

State: 14 values of ``frames.STATE_NAMES``, SI, rad/s; position and velocity of the **reference point**, inertial rate.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics import chaser as p
from lerobot_spacedock.physics.chaser import ChaserParameters
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.frames import ACTION_DIM, STATE_DIM
from lerobot_spacedock.physics.relative_motion import hcw_transition_row, sine_cosine
from lerobot_spacedock.physics.rigid_body import (
    advance_attitude,
    axpy,
    cross,
    multiply_matrix,
    multiply_quaternions,
    rotate_vector,
    rotate_vector_inverse,
    scaled,
)

SUBSTEP_ANGLE_rad = 0.03  # whole episodes then stay within 1e-6 m and 1e-8 rad (tests/physics/test_propagate.py)
MAX_SUBSTEPS = 4096


@jit(inline="always")
def substeps_needed(omega, alpha, step_s):
    """How many substeps keep the turn in each below ``SUBSTEP_ANGLE_rad``; ``MAX_SUBSTEPS`` at most."""
    rate2 = omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2
    growth2 = (alpha[0] ** 2 + alpha[1] ** 2 + alpha[2] ** 2) * step_s * step_s
    # (a + b)² ≤ 2 (a² + b²): the usual case, without a root
    if 2.0 * (rate2 + growth2) * step_s * step_s < SUBSTEP_ANGLE_rad * SUBSTEP_ANGLE_rad:
        return 1
    turns = (math.sqrt(rate2) + math.sqrt(growth2)) * step_s / SUBSTEP_ANGLE_rad
    if not turns < MAX_SUBSTEPS:
        return MAX_SUBSTEPS
    return 1 + int(turns)


@jit
def propagate_row(state, action, step_s, parameters, row, mean_motion_rad_s, hill_coupling, substeps):
    """One chaser over one step of held command.

    Args:
        state: 14-tuple, SI.
        action: N and N·m, 6-tuple, body axes, as commanded.
        step_s: s.
        parameters: (N, PARAMETER_DIM) packed chasers, of which ``row`` is meant.
        mean_motion_rad_s: rad/s.
        hill_coupling: the Hill frame turns under the attitude; False takes it as inertial (the reference rollouts).
        substeps: how many, or 0 for as many as needed.

    Returns:
        14-tuple, the state after the step.
    """
    r, v, mass = (state[0], state[1], state[2]), (state[3], state[4], state[5]), state[6]
    q, omega = (state[7], state[8], state[9], state[10]), (state[11], state[12], state[13])
    n = mean_motion_rad_s

    thrust = multiply_matrix(parameters, row, p.THRUST_MAP, (action[0], action[1], action[2]))
    torque = multiply_matrix(parameters, row, p.TORQUE_MAP, (action[3], action[4], action[5]))
    at = p.TORQUE_BIAS
    torque = axpy(1.0, torque, (parameters[row, at], parameters[row, at + 1], parameters[row, at + 2]))
    at = p.COM_OFFSET
    offset = (parameters[row, at], parameters[row, at + 1], parameters[row, at + 2])
    off_centre = offset[0] != 0.0 or offset[1] != 0.0 or offset[2] != 0.0
    if off_centre:
        torque = axpy(-1.0, cross(offset, thrust), torque)
        # HCW moves the centre of mass; the state is that of the reference point
        r, v = shift_point(r, v, q, omega, offset, 1.0, n, hill_coupling)
    flow = -math.sqrt(thrust[0] ** 2 + thrust[1] ** 2 + thrust[2] ** 2) / parameters[row, p.EXHAUST_SPEED]

    count = substeps
    if count <= 0:
        count = substeps_needed(omega, multiply_matrix(parameters, row, p.INERTIA_INVERSE, torque), step_s)
    h = step_s / count
    isotropic = parameters[row, p.ISOTROPIC] != 0.0
    sine_quarter, cosine_quarter = sine_cosine(0.25 * n * h)
    sine_half = 2.0 * sine_quarter * cosine_quarter
    cosine_half = 1.0 - 2.0 * sine_quarter * sine_quarter
    none = (0.0, 0.0, 0.0)
    for _ in range(count):
        a_start = rotate_vector(q, scaled(1.0 / mass, thrust))
        q, omega = advance_attitude(q, omega, torque, 0.5 * h, isotropic, parameters, row, p.INERTIA, p.INERTIA_INVERSE)
        if hill_coupling:
            q = multiply_quaternions((cosine_quarter, 0.0, 0.0, -sine_quarter), q)
        mass_middle = mass + 0.5 * h * flow
        a_middle = rotate_vector(q, scaled(1.0 / mass_middle, thrust))
        q, omega = advance_attitude(q, omega, torque, 0.5 * h, isotropic, parameters, row, p.INERTIA, p.INERTIA_INVERSE)
        if hill_coupling:
            q = multiply_quaternions((cosine_quarter, 0.0, 0.0, -sine_quarter), q)
        mass = mass + h * flow
        a_end = rotate_vector(q, scaled(1.0 / mass, thrust))

        sixth = h / 6.0
        r, v = hcw_transition_row(r, axpy(sixth, a_start, v), n, sine_half, cosine_half, h)
        r_middle, v_middle = hcw_transition_row(none, a_middle, n, sine_quarter, cosine_quarter, 0.5 * h)
        r = axpy(4.0 * sixth, r_middle, r)
        v = axpy(4.0 * sixth, v_middle, v)
        v = axpy(sixth, a_end, v)

    if off_centre:
        r, v = shift_point(r, v, q, omega, offset, -1.0, n, hill_coupling)
    return (
        r[0], r[1], r[2], v[0], v[1], v[2], mass, q[0], q[1], q[2], q[3], omega[0], omega[1], omega[2],
    )  # fmt: skip


@jit(inline="always")
def shift_point(r, v, q, omega, offset, sign, mean_motion_rad_s, hill_coupling):
    """Position and velocity (Hill axes) of the point at ``sign * offset`` (body axes) from the given one."""
    arm = rotate_vector(q, offset)
    rate = omega
    if hill_coupling:
        hill_rate = rotate_vector_inverse(q, (0.0, 0.0, mean_motion_rad_s))
        rate = axpy(-1.0, hill_rate, omega)
    swing = rotate_vector(q, cross(rate, offset))
    return axpy(sign, arm, r), axpy(sign, swing, v)


@jit
def _propagate_rows(state, action, step_s, parameters, n, hill_coupling, substeps, out, first, last):
    shared = parameters.shape[0] == 1
    for k in range(first, last):
        i = np.uintp(k)  # unsigned: numba then leaves out its test for negative indices
        before = (
            state[i, 0], state[i, 1], state[i, 2], state[i, 3], state[i, 4], state[i, 5], state[i, 6],
            state[i, 7], state[i, 8], state[i, 9], state[i, 10], state[i, 11], state[i, 12], state[i, 13],
        )  # fmt: skip
        held = (action[i, 0], action[i, 1], action[i, 2], action[i, 3], action[i, 4], action[i, 5])
        row = np.uintp(0) if shared else i
        after = propagate_row(before, held, step_s[i], parameters, row, n, hill_coupling, substeps)
        for j in range(STATE_DIM):
            out[i, j] = after[j]


@jit(parallel=True)
def _propagate_parallel(state, action, step_s, parameters, n, hill_coupling, substeps, out, blocks):
    count = state.shape[0]
    for b in prange(blocks):
        _propagate_rows(
            state, action, step_s, parameters, n, hill_coupling, substeps, out,
            b * count // blocks, (b + 1) * count // blocks,
        )  # fmt: skip


def propagate(
    state: np.ndarray,
    action: np.ndarray,
    step_s: np.ndarray | float,
    chaser: ChaserParameters | np.ndarray,
    *,
    mean_motion_rad_s: float = MEAN_MOTION_rad_s,
    hill_coupling: bool = False,
    substeps: int = 0,
    threads: int = 1,
) -> np.ndarray:
    """A batch of chasers over one step of held command.

    Args:
        state: SI, (N, 14), rates in rad/s.
        action: N and N·m, (N, 6), body axes.
        step_s: s, scalar or (N,), at least 0.
        chaser: parameters of N chasers, or of one that all share; packed or not.
        mean_motion_rad_s: rad/s.
        hill_coupling: the attitude feels the Hill frame turn.
        substeps: how many a step, or 0 for as many as the rates ask for.
        threads: blocks run in parallel (numba's threads); 1 starts no thread. The result is the same to the bit.

    Returns:
        (N, 14), a new array.

    Raises:
        InputError: a shape that does not fit.
    """
    state = np.ascontiguousarray(state, dtype=np.float64)
    action = np.ascontiguousarray(action, dtype=np.float64)
    if state.ndim != 2 or state.shape[1] != STATE_DIM:
        raise InputError("state", f"shape {state.shape}", f"(N, {STATE_DIM})")
    if action.shape != (len(state), ACTION_DIM):
        raise InputError("action", f"shape {action.shape}", f"({len(state)}, {ACTION_DIM}), one row a state")
    step_s = np.ascontiguousarray(np.broadcast_to(np.asarray(step_s, dtype=np.float64), (len(state),)))
    parameters = chaser.pack() if isinstance(chaser, ChaserParameters) else chaser
    if parameters.shape[0] not in (1, len(state)):
        raise InputError("chaser", f"{parameters.shape[0]} rows", f"1 or {len(state)} rows")
    out = np.empty_like(state)
    if threads > 1:
        blocks = max(1, min(4 * threads, len(state)))
        _propagate_parallel(state, action, step_s, parameters, mean_motion_rad_s, hill_coupling, substeps, out, blocks)
    else:
        _propagate_rows(
            state, action, step_s, parameters, mean_motion_rad_s, hill_coupling, substeps, out, 0, len(state)
        )
    return out
