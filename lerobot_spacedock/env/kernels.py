"""The simulator's inner loops: reset, step and observe, over rows of a batch. Numba; no Python object in them."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from lerobot_spacedock.env.random import STREAM_NEXT, STREAM_NOISE, bits, normal_pair
from lerobot_spacedock.env.reward import step_terms
from lerobot_spacedock.env.scenario import (
    SENSOR_BIAS,
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
    time_of_crossing,
)
from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics.propagate import propagate_row
from lerobot_spacedock.physics.rigid_body import (
    axpy,
    multiply_quaternions,
    rotate_vector_inverse,
    rotation_vector_to_quaternion,
)

RAD_TO_DEG = 180.0 / math.pi


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
def step_row(i, action, grid, sim, task):
    """Flies row ``i`` over one step; a row that has ended stays as it is."""
    if sim.code[i] != RUNNING:
        sim.reward[i] = 0.0
        return
    sim.clipped_now[i] = False
    for j in range(6):
        limit = task.limits[j]
        value = action[i, j]
        if value > limit or value < -limit:
            sim.clipped_now[i] = True
            value = limit if value > 0.0 else -limit
        sim.action[i, j] = value
    if sim.clipped_now[i]:
        sim.clipped[i] += 1
    held = (
        sim.action[i, 0], sim.action[i, 1], sim.action[i, 2], sim.action[i, 3], sim.action[i, 4], sim.action[i, 5],
    )  # fmt: skip
    previous = (
        sim.previous[i, 0], sim.previous[i, 1], sim.previous[i, 2],
        sim.previous[i, 3], sim.previous[i, 4], sim.previous[i, 5],
    )  # fmt: skip
    s = sim.state
    before = (
        s[i, 0], s[i, 1], s[i, 2], s[i, 3], s[i, 4], s[i, 5], s[i, 6],
        s[i, 7], s[i, 8], s[i, 9], s[i, 10], s[i, 11], s[i, 12], s[i, 13],
    )  # fmt: skip

    if len(grid) > 0:
        dt = grid[sim.step[i]]
    elif task.fixed_step:
        dt = task.step_mean
    else:
        dt = draw_step(sim.key[i], sim.step[i], task.step_mean, task.step_std, task.step_min, task.step_max)
    parameters, n, coupling = sim.parameters, task.mean_motion, task.coupling
    after = propagate_row(before, held, dt, parameters, i, n, coupling, 0)

    code = RUNNING
    if task.contact:
        crossing = time_of_crossing(before, after, held, dt, parameters, i, n, coupling, task.axial_sign)
        if crossing >= 0.0:
            at_plane = propagate_row(before, held, crossing, parameters, i, n, coupling, 0)
            code = judge_place(
                (at_plane[0], at_plane[1], at_plane[2]), task.axial_sign, True, task.capture_radius,
                task.station_radius, task.corridor, task.corridor_tangent, task.corridor_mouth, task.volume_radius,
            )  # fmt: skip
            if code != RUNNING:
                after, dt = at_plane, crossing
        if code == RUNNING:
            code = judge_place(
                (after[0], after[1], after[2]), task.axial_sign, False, task.capture_radius,
                task.station_radius, task.corridor, task.corridor_tangent, task.corridor_mouth, task.volume_radius,
            )  # fmt: skip

    sim.step[i] += 1
    sim.time[i] += dt
    sim.dt[i] = dt
    horizon = len(grid) if len(grid) > 0 else task.max_steps
    if code == RUNNING and sim.step[i] >= horizon:
        code = TIMEOUT if task.contact else HORIZON
    finite = True
    for j in range(14):
        s[i, j] = after[j]
        finite = finite and math.isfinite(after[j])
    if not finite or after[6] <= 0.0:
        code = BROKEN
    sim.code[i] = code

    q = (after[7], after[8], after[9], after[10])
    inverse = (task.q_nominal[0], -task.q_nominal[1], -task.q_nominal[2], -task.q_nominal[3])
    error = multiply_quaternions(inverse, q)
    omega = (after[11], after[12], after[13])
    if coupling:
        omega = axpy(-1.0, rotate_vector_inverse(q, (0.0, 0.0, n)), omega)
    sim.reward[i] = step_terms(
        task.axial_sign, (after[0], after[1], after[2]), (after[3], after[4], after[5]),
        error, omega, held, previous, sim.step[i] == 1, task.weights, sim.terms, i,
    )  # fmt: skip
    for j in range(6):
        sim.previous[i, j] = held[j]


@jit
def step_rows(first, last, action, grid, sim, task):
    """Flies rows ``first`` to ``last`` - 1 over one step."""
    for k in range(first, last):
        step_row(np.uintp(k), action, grid, sim, task)  # unsigned: no test for negative indices


@jit(parallel=True)
def step_parallel(blocks, action, grid, sim, task):
    """The same as ``step_rows`` over all rows, in blocks over numba's threads; the same to the bit."""
    count = len(sim.step)
    for b in prange(blocks):
        step_rows(b * count // blocks, (b + 1) * count // blocks, action, grid, sim, task)


@jit
def observe_rows(first, last, sim, out):
    """Fills ``out`` (N, 14) float64 with what the sensors give, in the dataset's order and units (deg/s)."""
    for k in range(first, last):
        i = np.uintp(k)
        s, sensor = sim.state, sim.sensor
        for j in range(14):
            out[i, j] = s[i, j]
        if sensor[i, SENSOR_NOISE] > 0.0 or sensor[i, SENSOR_BIAS] != 0.0:
            _add_sensor_errors(i, sim, out)
        for j in range(3):
            out[i, 11 + j] *= RAD_TO_DEG


@jit(parallel=True)
def observe_parallel(blocks, sim, out):
    """The same as ``observe_rows`` over all rows, in blocks over numba's threads."""
    count = len(sim.step)
    for b in prange(blocks):
        observe_rows(b * count // blocks, (b + 1) * count // blocks, sim, out)


@jit
def _add_sensor_errors(i, sim, out):
    key, sensor = sim.key[i], sim.sensor
    at = 6 * sim.step[i]
    a0, a1 = normal_pair(key, STREAM_NOISE, at)
    a2, a3 = normal_pair(key, STREAM_NOISE, at + 1)
    a4, a5 = normal_pair(key, STREAM_NOISE, at + 2)
    a6, a7 = normal_pair(key, STREAM_NOISE, at + 3)
    a8, a9 = normal_pair(key, STREAM_NOISE, at + 4)
    a10, a11 = normal_pair(key, STREAM_NOISE, at + 5)
    distance = math.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2)
    noise = SENSOR_NOISE
    sigma = sensor[i, noise] + sensor[i, SENSOR_RANGE_NOISE] * distance
    out[i, 0] += sensor[i, 0] + sigma * a0
    out[i, 1] += sensor[i, 1] + sigma * a1
    out[i, 2] += sensor[i, 2] + sigma * a2
    out[i, 3] += sensor[i, 3] + sensor[i, noise + 1] * a3
    out[i, 4] += sensor[i, 4] + sensor[i, noise + 1] * a4
    out[i, 5] += sensor[i, 5] + sensor[i, noise + 1] * a5
    sigma = sensor[i, noise + 2]
    turn = rotation_vector_to_quaternion(
        (sensor[i, 6] + sigma * a6, sensor[i, 7] + sigma * a7, sensor[i, 8] + sigma * a8)
    )
    q = multiply_quaternions((out[i, 7], out[i, 8], out[i, 9], out[i, 10]), turn)
    out[i, 7], out[i, 8], out[i, 9], out[i, 10] = q
    out[i, 11] += sensor[i, 9] + sensor[i, noise + 3] * a9
    out[i, 12] += sensor[i, 10] + sensor[i, noise + 3] * a10
    out[i, 13] += sensor[i, 11] + sensor[i, noise + 3] * a11
