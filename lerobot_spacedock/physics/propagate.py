"""One chaser or a batch, over a step of held command: HCW translation under a thrust that turns with the body.

Method, per substep ``h``: the attitude by two half steps (``rigid_body.py``); the translation by the exact HCW
transition of its start, plus the thrust's integral by Simpson's rule over start, middle and end, each carried to the
end by the exact transition; the mass linear in time, as a constant flow makes it. Order 4 in ``h``; exact for a
thrust that keeps its direction at constant mass, but for that integral, whose error grows with the fourth power of the
orbital angle. Substeps are as many as keep the turn of the body, and that of the orbit, below ``SUBSTEP_ANGLE_rad`` in
each: one, in any sane docking.

A batch flies in blocks of ``LANES`` chasers, column by column in a scratch array, so that the compiler puts several
into one vector register; what is unusual (more than one substep, an inertia unlike its neighbours') flies by itself.
Both ways are the same arithmetic (``substep.py``) and agree to the bit.

State: 14 values of ``frames.STATE_NAMES``, SI, rad/s; position and velocity of the **reference point**, inertial rate.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics import chaser as p
from lerobot_spacedock.physics.block import (
    BLOCK_ACTION,
    BLOCK_AFTER,
    BLOCK_CHASER,
    BLOCK_ROWS,
    BLOCK_STATE,
    BLOCK_STEP,
    BLOCK_UNUSUAL,
    LANES,
    get,
    get3,
    get4,
    get6,
    get9,
    get14,
    put,
    put3,
    put4,
)
from lerobot_spacedock.physics.chaser import ChaserParameters
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.frames import ACTION_DIM, STATE_DIM
from lerobot_spacedock.physics.relative_motion import SMALL_ANGLE_rad, sine_cosine, small_sine_cosine
from lerobot_spacedock.physics.rigid_body import axpy, cross, multiply_matrix, scaled
from lerobot_spacedock.physics.substep import (
    executed,
    halves_general,
    halves_isotropic,
    shift_point,
    substep,
)

SUBSTEP_ANGLE_rad = 0.03  # whole episodes then stay within a few 1e-6 m and 1e-8 rad (tests/physics/test_propagate.py)
MAX_SUBSTEPS = 4096


@jit
def substeps_needed(turn2, step_s):
    """How many substeps keep the turn of body and orbit in each below ``SUBSTEP_ANGLE_rad``; ``MAX_SUBSTEPS`` at most.

    ``turn2``: (rad/s)², squares of the rate at the start and of its growth over the step.
    """
    if is_one_substep(turn2, step_s):
        return 1
    turns = max(math.sqrt(turn2[0]) + math.sqrt(turn2[1]), MEAN_MOTION_rad_s) * step_s / SUBSTEP_ANGLE_rad
    if not turns < MAX_SUBSTEPS:
        return MAX_SUBSTEPS
    return 1 + int(turns)


@jit(forceinline=True)
def is_one_substep(turn2, step_s):
    """The usual case, decided without a root: (a + b)² ≤ 2 (a² + b²)."""
    least2 = max(2.0 * (turn2[0] + turn2[1]), MEAN_MOTION_rad_s * MEAN_MOTION_rad_s)
    return least2 * step_s * step_s < SUBSTEP_ANGLE_rad * SUBSTEP_ANGLE_rad


@jit(forceinline=True)
def squared_turn(omega, acceleration, step_s):
    """Squares of a rate and of what an acceleration adds to it in a step, (rad/s)²."""
    growth = scaled(step_s, acceleration)
    return (
        omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2],
        growth[0] * growth[0] + growth[1] * growth[1] + growth[2] * growth[2],
    )


@jit(forceinline=True)
def columns(a, first, row):
    """The nine values ``a[row, first : first + 9]`` as a tuple."""
    return (
        a[row, first], a[row, first + 1], a[row, first + 2], a[row, first + 3], a[row, first + 4], a[row, first + 5],
        a[row, first + 6], a[row, first + 7], a[row, first + 8],
    )  # fmt: skip


@jit(forceinline=True)
def columns3(a, first, row):
    """The three values ``a[row, first : first + 3]`` as a tuple."""
    return (a[row, first], a[row, first + 1], a[row, first + 2])


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
    per_n = 1.0 / n
    frame_rate = n if hill_coupling else 0.0

    inertia, inverse = columns(parameters, p.INERTIA, row), columns(parameters, p.INERTIA_INVERSE, row)
    thrust, torque = executed(
        action, columns(parameters, p.THRUST_MAP, row), columns(parameters, p.TORQUE_MAP, row),
        columns3(parameters, p.TORQUE_BIAS, row),
    )  # fmt: skip
    offset = columns3(parameters, p.COM_OFFSET, row)
    flow = mass_flow(thrust, parameters[row, p.EXHAUST_SPEED])
    simple = parameters[row, p.SIMPLE] != 0.0
    if not simple:
        torque = axpy(-1.0, cross(offset, thrust), torque)
        # HCW moves the centre of mass; the state is that of the reference point
        r, v = shift_point(r, v, q, omega, offset, 1.0, frame_rate)
    acceleration = multiply_matrix(inverse, torque)

    count = substeps
    if count <= 0:
        count = substeps_needed(squared_turn(omega, acceleration, step_s), step_s)
    h = step_s / count
    quarter = sine_cosine(0.25 * n * h)
    half = doubled(quarter)
    sine, cosine = sine_cosine(0.25 * frame_rate * h)
    frame = (cosine, sine)
    for _ in range(count):
        if simple:
            first, second = halves_isotropic(omega, acceleration, h)
        else:
            first, second = halves_general(omega, torque, inertia, inverse, h)
        r, v, mass, q, omega = substep(
            r, v, mass, q, omega, thrust, flow, first, second, h, n, per_n, quarter, half, frame
        )
    if not simple:
        r, v = shift_point(r, v, q, omega, offset, -1.0, frame_rate)
    return (
        r[0], r[1], r[2], v[0], v[1], v[2], mass, q[0], q[1], q[2], q[3], omega[0], omega[1], omega[2],
    )  # fmt: skip


@jit(forceinline=True)
def mass_flow(thrust, exhaust_speed_m_s):
    """kg/s, negative: thrust (N, 3-tuple) over exhaust speed."""
    return -math.sqrt(thrust[0] * thrust[0] + thrust[1] * thrust[1] + thrust[2] * thrust[2]) / exhaust_speed_m_s


@jit(forceinline=True)
def doubled(half):
    """Sine and cosine of twice the angle."""
    return 2.0 * half[0] * half[1], 1.0 - 2.0 * half[0] * half[0]


@jit
def propagate_block(block, lanes, mean_motion_rad_s, hill_coupling):
    """Flies the first ``lanes`` columns of a block (see ``BLOCK_STATE`` and its neighbours) over one step.

    Lanes that are not as lane 0, or that need more than one substep, are flown one by one; the others in the two
    loops below, which have no branch and so become vector instructions.
    """
    n = mean_motion_rad_s
    per_n = 1.0 / n
    frame_rate = n if hill_coupling else 0.0
    b = block
    at = BLOCK_CHASER
    if get(b, at + p.SIMPLE, np.uintp(0)) != 0.0:
        for lane in range(lanes):
            k = np.uintp(lane)
            h = get(b, BLOCK_STEP, k)
            r, v, mass, q, omega = lane_state(b, k)
            thrust, torque = executed(
                get6(b, BLOCK_ACTION, k), get9(b, at + p.THRUST_MAP, k), get9(b, at + p.TORQUE_MAP, k),
                get3(b, at + p.TORQUE_BIAS, k),
            )  # fmt: skip
            acceleration = multiply_matrix(get9(b, at + p.INERTIA_INVERSE, k), torque)
            flow = mass_flow(thrust, get(b, at + p.EXHAUST_SPEED, k))
            quarter = small_sine_cosine(0.25 * n * h)
            sine, cosine = small_sine_cosine(0.25 * frame_rate * h)
            one = is_one_substep(squared_turn(omega, acceleration, h), h)
            usual = one & (abs(0.25 * n * h) < SMALL_ANGLE_rad) & (get(b, at + p.SIMPLE, k) != 0.0)
            first, second = halves_isotropic(omega, acceleration, h)
            r, v, mass, q, omega = substep(
                r, v, mass, q, omega, thrust, flow, first, second, h, n, per_n, quarter, doubled(quarter),
                (cosine, sine),
            )  # fmt: skip
            keep_lane(b, k, r, v, mass, q, omega, usual)
    else:
        for lane in range(lanes):
            k = np.uintp(lane)
            h = get(b, BLOCK_STEP, k)
            r, v, mass, q, omega = lane_state(b, k)
            inertia, inverse = get9(b, at + p.INERTIA, k), get9(b, at + p.INERTIA_INVERSE, k)
            thrust, torque = executed(
                get6(b, BLOCK_ACTION, k), get9(b, at + p.THRUST_MAP, k), get9(b, at + p.TORQUE_MAP, k),
                get3(b, at + p.TORQUE_BIAS, k),
            )  # fmt: skip
            offset = get3(b, at + p.COM_OFFSET, k)
            torque = axpy(-1.0, cross(offset, thrust), torque)
            r, v = shift_point(r, v, q, omega, offset, 1.0, frame_rate)
            acceleration = multiply_matrix(inverse, torque)
            flow = mass_flow(thrust, get(b, at + p.EXHAUST_SPEED, k))
            quarter = small_sine_cosine(0.25 * n * h)
            sine, cosine = small_sine_cosine(0.25 * frame_rate * h)
            one = is_one_substep(squared_turn(omega, acceleration, h), h)
            usual = one & (abs(0.25 * n * h) < SMALL_ANGLE_rad) & (get(b, at + p.SIMPLE, k) == 0.0)
            first, second = halves_general(omega, torque, inertia, inverse, h)
            r, v, mass, q, omega = substep(
                r, v, mass, q, omega, thrust, flow, first, second, h, n, per_n, quarter, doubled(quarter),
                (cosine, sine),
            )  # fmt: skip
            r, v = shift_point(r, v, q, omega, offset, -1.0, frame_rate)
            keep_lane(b, k, r, v, mass, q, omega, usual)


@jit(forceinline=True)
def lane_state(b, k):
    """(r, v, mass, q, omega) of lane ``k`` before the step."""
    return get3(b, 0, k), get3(b, 3, k), get(b, 6, k), get4(b, 7, k), get3(b, 11, k)


@jit(forceinline=True)
def keep_lane(b, k, r, v, mass, q, omega, usual):
    """Writes what ``propagate_block`` made of lane ``k``."""
    at = BLOCK_AFTER
    put3(b, at, k, r)
    put3(b, at + 3, k, v)
    put(b, at + 6, k, mass)
    put4(b, at + 7, k, q)
    put3(b, at + 11, k, omega)
    put(b, BLOCK_UNUSUAL, k, 0.0 if usual else 1.0)


@jit
def _propagate_rows(state, action, step_s, parameters, n, hill_coupling, substeps, out, first, last):
    shared = parameters.shape[0] == 1
    block = np.zeros(BLOCK_ROWS * LANES)
    if shared:
        for j in range(p.PARAMETER_DIM):
            for k in range(LANES):
                block[(BLOCK_CHASER + j) * LANES + k] = parameters[0, j]
    for start in range(first, last, LANES):
        lanes = min(LANES, last - start)
        for lane in range(lanes):
            k, i = np.uintp(lane), np.uintp(start + lane)
            for j in range(STATE_DIM):
                put(block, j, k, state[i, j])
            for j in range(ACTION_DIM):
                put(block, BLOCK_ACTION + j, k, action[i, j])
            put(block, BLOCK_STEP, k, step_s[i])
            if not shared:
                for j in range(p.PARAMETER_DIM):
                    put(block, BLOCK_CHASER + j, k, parameters[i, j])
        if substeps <= 0:
            propagate_block(block, lanes, n, hill_coupling)
        for lane in range(lanes):
            k, i = np.uintp(lane), np.uintp(start + lane)
            if substeps <= 0 and get(block, BLOCK_UNUSUAL, k) == 0.0:
                for j in range(STATE_DIM):
                    out[i, j] = get(block, BLOCK_AFTER + j, k)
                continue
            row = np.uintp(0) if shared else i
            before, held = get14(block, BLOCK_STATE, k), get6(block, BLOCK_ACTION, k)
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
