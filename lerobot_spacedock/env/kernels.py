"""The simulator's inner loops: reset, step and observe, over rows of a batch. Numba; no Python object in them.

A step and a reading go block by block (``physics.block``): rows of the simulation are laid out as the lanes of a
small scratch array, so that loops without a branch over the lanes become vector instructions. What a lane holds does
not depend on its neighbours, nor does the arithmetic: one row flies as a million do, to the bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from lerobot_spacedock.env.random import STREAM_NEXT, STREAM_NOISE, bits, normal_pair
from lerobot_spacedock.env.reward import STEP_TERMS, step_terms, wanted_closing_speed, weight_scalars
from lerobot_spacedock.env.scenario import (
    SENSOR_DIM,
    SENSOR_NOISE,
    SENSOR_RANGE_NOISE,
    draw_chaser,
    draw_sensor,
    draw_start,
    draw_step,
    set_nominal_chaser,
)
from lerobot_spacedock.env.termination import (
    BROKEN,
    HORIZON,
    RUNNING,
    TIMEOUT,
    judge_place,
    may_cross,
    time_of_crossing,
)
from lerobot_spacedock.jit import jit
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
    get14,
    put,
    put3,
    put4,
    put14,
)
from lerobot_spacedock.physics.chaser import PARAMETER_DIM
from lerobot_spacedock.physics.frames import ACTION_DIM, RAD_TO_DEG, STATE_DIM
from lerobot_spacedock.physics.propagate import propagate_block, propagate_row
from lerobot_spacedock.physics.rigid_body import (
    axpy,
    multiply_quaternions,
    rotate_vector_inverse,
    rotation_vector_to_quaternion,
)

# rows of a block beside those of the propagation
PREVIOUS = BLOCK_ROWS  # 6, the command before
CHANGED = PREVIOUS + ACTION_DIM  # 1: 0.0 in an episode's first step, which has none before
FLYING = CHANGED + 1  # 1: the episode had not ended before this step
CLIPPED = FLYING + 1  # 1: the command was beyond the limits
WANTED = CLIPPED + 1  # 1, m/s, closing speed the reward asks for
TERMS = WANTED + 1  # 7, of the reward
TERMS_COUNT = len(STEP_TERMS)
REWARD = TERMS + TERMS_COUNT  # 1, their sum
SOUND = REWARD + 1  # 1: 0.0 where every state value is finite, else NaN
ROWS = SOUND + 1
# rows of a block in a reading
NOISE = STATE_DIM  # 12, standard normals
ERRORS = NOISE + 12  # SENSOR_DIM
READING_ROWS = ERRORS + SENSOR_DIM


@jit
def reset_rows(rows, sim, task):
    """Starts the episodes of ``rows`` from their keys ``sim.key``."""
    for at in range(len(rows)):
        i = rows[at]
        key = sim.key[i]
        if task.meta:
            mass = draw_chaser(key, task.ranges, sim.parameters, i)
            draw_sensor(key, task.ranges, sim.sensor, i)
        else:
            mass = set_nominal_chaser(sim.parameters, i)
            for j in range(SENSOR_DIM):
                sim.sensor[i, j] = 0.0
        draw_start(key, task.start_bounds, task.mirror, task.q_nominal, mass, sim.state, i)
        sim.step[i] = 0
        sim.time[i] = 0.0
        sim.code[i] = RUNNING
        sim.clipped[i] = 0
        for j in range(6):
            sim.previous[i, j] = 0.0


@jit
def next_keys(rows, sim):
    """Gives ``rows`` the keys of their next episodes: a chain that starts at the first key."""
    for at in range(len(rows)):
        sim.key[rows[at]] = bits(sim.key[rows[at]], STREAM_NEXT, 0)


@jit
def step_rows(first, last, action, grid, sim, task):
    """Flies rows ``first`` to ``last`` - 1 over one step, in blocks; a row that has ended stays as it is."""
    block = np.zeros(ROWS * LANES)
    for start in range(first, last, LANES):
        lanes = min(LANES, last - start)
        _fill_block(block, start, lanes, action, grid, sim, task)
        propagate_block(block, lanes, task.mean_motion, task.coupling)
        _judge_block(block, start, lanes, sim, task)
        _price_block(block, lanes, task)
        _keep_block(block, start, lanes, grid, sim, task)


@jit
def _fill_block(block, start, lanes, action, grid, sim, task):
    """States, clipped commands, chasers and lengths of the step."""
    if task.fixed_step:
        for lane in range(lanes):
            put(block, BLOCK_STEP, np.uintp(lane), task.step_mean)
    else:
        mean, std, least, most = task.step_mean, task.step_std, task.step_min, task.step_max
        for lane in range(lanes):
            i = np.uintp(start + lane)
            put(block, BLOCK_STEP, np.uintp(lane), draw_step(sim.key[i], sim.step[i], mean, std, least, most))
    for lane in range(lanes):
        k, i = np.uintp(lane), np.uintp(start + lane)
        if len(grid) > 0 and sim.code[i] == RUNNING:
            put(block, BLOCK_STEP, k, grid[sim.step[i]])
        clipped = False
        for j in range(ACTION_DIM):
            limit, value = task.limits[j], action[i, j]
            clipped |= abs(value) > limit
            value = value if value < limit else limit
            put(block, BLOCK_ACTION + j, k, value if value > -limit else -limit)
            put(block, PREVIOUS + j, k, sim.previous[i, j])
        put(block, FLYING, k, 1.0 if sim.code[i] == RUNNING else 0.0)
        put(block, CLIPPED, k, 1.0 if clipped else 0.0)
        put(block, CHANGED, k, 0.0 if sim.step[i] == 0 else 1.0)
        for j in range(STATE_DIM):
            put(block, j, k, sim.state[i, j])
        for j in range(PARAMETER_DIM):
            put(block, BLOCK_CHASER + j, k, sim.parameters[i, j])


@jit
def _judge_block(block, start, lanes, sim, task):
    """Finishes the flights: of unusual lanes by themselves, of those that met the port plane up to it."""
    n, coupling, sign = task.mean_motion, task.coupling, task.axial_sign
    for lane in range(lanes):
        k, i = np.uintp(lane), np.uintp(start + lane)
        if get(block, FLYING, k) == 0.0:
            continue
        dt = get(block, BLOCK_STEP, k)
        if get(block, BLOCK_UNUSUAL, k) != 0.0:
            before, held = get14(block, BLOCK_STATE, k), get6(block, BLOCK_ACTION, k)
            put14(block, BLOCK_AFTER, k, propagate_row(before, held, dt, sim.parameters, i, n, coupling, 0))
        if not task.contact:
            continue
        code = RUNNING
        near, far = sign * get(block, BLOCK_AFTER + 1, k), sign * get(block, BLOCK_STATE + 1, k)
        if may_cross(far, near, sign * get(block, BLOCK_STATE + 4, k), sign * get(block, BLOCK_AFTER + 4, k), dt):
            before, held = get14(block, BLOCK_STATE, k), get6(block, BLOCK_ACTION, k)
            after = get14(block, BLOCK_AFTER, k)
            crossing = time_of_crossing(before, after, held, dt, sim.parameters, i, n, coupling, sign)
            if crossing >= 0.0:
                at_plane = propagate_row(before, held, crossing, sim.parameters, i, n, coupling, 0)
                code = judge_place(
                    (at_plane[0], at_plane[1], at_plane[2]), sign, True, task.capture_radius, task.station_radius,
                    task.corridor, task.corridor_tangent, task.corridor_mouth, task.volume_radius,
                )  # fmt: skip
                if code != RUNNING:
                    put14(block, BLOCK_AFTER, k, at_plane)
                    put(block, BLOCK_STEP, k, crossing)
        if code == RUNNING:
            code = judge_place(
                get3(block, BLOCK_AFTER, k), sign, False, task.capture_radius, task.station_radius,
                task.corridor, task.corridor_tangent, task.corridor_mouth, task.volume_radius,
            )  # fmt: skip
        sim.code[i] = code


@jit
def _price_block(block, lanes, task):
    """The reward's terms; the loop has no branch and so becomes vector instructions."""
    sign = task.axial_sign
    frame_rate = task.mean_motion if task.coupling else 0.0
    w = weight_scalars(task.weights)
    nominal = task.q_nominal
    inverse = (nominal[0], -nominal[1], -nominal[2], -nominal[3])
    for lane in range(lanes):
        k = np.uintp(lane)
        put(block, WANTED, k, wanted_closing_speed(sign * get(block, BLOCK_AFTER + 1, k), task.weights))
    for lane in range(lanes):
        k, at = np.uintp(lane), BLOCK_AFTER
        r, v = get3(block, at, k), get3(block, at + 3, k)
        q, body_rate = get4(block, at + 7, k), get3(block, at + 11, k)
        omega = axpy(-1.0, rotate_vector_inverse(q, (0.0, 0.0, frame_rate)), body_rate)
        terms = step_terms(
            sign, r, v, multiply_quaternions(inverse, q), omega, get6(block, BLOCK_ACTION, k), get6(block, PREVIOUS, k),
            get(block, WANTED, k), get(block, CHANGED, k), w,
        )  # fmt: skip
        put3(block, TERMS, k, (terms[0], terms[1], terms[2]))
        put4(block, TERMS + 3, k, (terms[3], terms[4], terms[5], terms[6]))
        put(block, REWARD, k, terms[0] + terms[1] + terms[2] + terms[3] + terms[4] + terms[5] + terms[6])
        total = r[0] + r[1] + r[2] + v[0] + v[1] + v[2] + get(block, at + 6, k)
        total += q[0] + q[1] + q[2] + q[3] + body_rate[0] + body_rate[1] + body_rate[2]
        put(block, SOUND, k, total - total)


@jit
def _keep_block(block, start, lanes, grid, sim, task):
    """Writes what became of the lanes; an episode that had ended before gives no more reward."""
    horizon = len(grid) if len(grid) > 0 else task.max_steps
    for lane in range(lanes):
        k, i = np.uintp(lane), np.uintp(start + lane)
        if get(block, FLYING, k) == 0.0:
            sim.reward[i] = 0.0
            continue
        for j in range(STATE_DIM):
            sim.state[i, j] = get(block, BLOCK_AFTER + j, k)
        for j in range(TERMS_COUNT):
            sim.terms[i, j] = get(block, TERMS + j, k)
        for j in range(ACTION_DIM):
            held = get(block, BLOCK_ACTION + j, k)
            sim.action[i, j] = held
            sim.previous[i, j] = held
        clipped = get(block, CLIPPED, k) != 0.0
        sim.clipped_now[i] = clipped
        sim.clipped[i] += 1 if clipped else 0
        sim.reward[i] = get(block, REWARD, k)
        dt = get(block, BLOCK_STEP, k)
        sim.step[i] += 1
        sim.time[i] += dt
        sim.dt[i] = dt
        if sim.code[i] == RUNNING and sim.step[i] >= horizon:
            sim.code[i] = TIMEOUT if task.contact else HORIZON
        if get(block, SOUND, k) != 0.0 or get(block, BLOCK_AFTER + 6, k) <= 0.0:
            sim.code[i] = BROKEN


@jit(parallel=True)
def step_parallel(blocks, action, grid, sim, task):
    """The same as ``step_rows`` over all rows, in blocks over numba's threads; the same to the bit."""
    count = len(sim.step)
    for b in prange(blocks):
        step_rows(b * count // blocks, (b + 1) * count // blocks, action, grid, sim, task)


@jit
def observe_rows(first, last, sim, out, columns):
    """Fills ``out`` (N, M) with what the sensors give of the state's ``columns`` (M,), in the dataset's units (deg/s).

    The reading of a row at its step is drawn from its key: reading again gives the same.
    """
    block = np.zeros(READING_ROWS * LANES)
    for start in range(first, last, LANES):
        lanes = min(LANES, last - start)
        blurred = False
        for lane in range(lanes):
            k, i = np.uintp(lane), np.uintp(start + lane)
            for j in range(STATE_DIM):
                put(block, j, k, sim.state[i, j])
            for j in range(SENSOR_DIM):
                blurred |= sim.sensor[i, j] != 0.0
        if blurred:
            _draw_noise(block, start, lanes, sim)
            _add_sensor_errors(block, lanes)
        for lane in range(lanes):
            k, i = np.uintp(lane), np.uintp(start + lane)
            for j in range(11, STATE_DIM):
                put(block, j, k, RAD_TO_DEG * get(block, j, k))
            for j in range(len(columns)):
                out[i, j] = get(block, columns[j], k)


@jit(parallel=True)
def observe_parallel(blocks, sim, out, columns):
    """The same as ``observe_rows`` over all rows, in blocks over numba's threads."""
    count = len(sim.step)
    for b in prange(blocks):
        observe_rows(b * count // blocks, (b + 1) * count // blocks, sim, out, columns)


@jit
def _draw_noise(block, start, lanes, sim):
    """Twelve standard normals a lane, and the sensor's errors of its episode."""
    for pair in range(6):
        for lane in range(lanes):
            k, i = np.uintp(lane), np.uintp(start + lane)
            a, b = normal_pair(sim.key[i], STREAM_NOISE, 6 * sim.step[i] + pair)
            put(block, NOISE + 2 * pair, k, a)
            put(block, NOISE + 2 * pair + 1, k, b)
    for lane in range(lanes):
        k, i = np.uintp(lane), np.uintp(start + lane)
        for j in range(SENSOR_DIM):
            put(block, ERRORS + j, k, sim.sensor[i, j])


@jit
def _add_sensor_errors(block, lanes):
    """Bias and noise on every reading: position's grows with the range, attitude's turns about body axes."""
    for lane in range(lanes):
        k = np.uintp(lane)
        r, v, q, omega = get3(block, 0, k), get3(block, 3, k), get4(block, 7, k), get3(block, 11, k)
        noise = ERRORS + SENSOR_NOISE
        distance = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        sigma = get(block, noise, k) + get(block, ERRORS + SENSOR_RANGE_NOISE, k) * distance
        put3(block, 0, k, axpy(sigma, get3(block, NOISE, k), axpy(1.0, get3(block, ERRORS, k), r)))
        sigma = get(block, noise + 1, k)
        put3(block, 3, k, axpy(sigma, get3(block, NOISE + 3, k), axpy(1.0, get3(block, ERRORS + 3, k), v)))
        sigma = get(block, noise + 2, k)
        turn = axpy(sigma, get3(block, NOISE + 6, k), get3(block, ERRORS + 6, k))
        put4(block, 7, k, multiply_quaternions(q, rotation_vector_to_quaternion(turn)))
        sigma = get(block, noise + 3, k)
        put3(block, 11, k, axpy(sigma, get3(block, NOISE + 9, k), axpy(1.0, get3(block, ERRORS + 9, k), omega)))
