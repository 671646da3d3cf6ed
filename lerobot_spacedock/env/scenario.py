"""Draws an episode from its key: the start, the chaser, the sensor. Numba, one row at a time."""

from __future__ import annotations

import math

from lerobot_spacedock.env.random import (
    STREAM_CHASER,
    STREAM_SENSOR,
    STREAM_START,
    STREAM_STEP,
    normal_pair,
    uniform_between,
)
from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics import chaser as p
from lerobot_spacedock.physics.constants import (
    CHASER_INERTIA_kg_m2,
    CHASER_MASS_kg,
    SPECIFIC_IMPULSE_s,
    STANDARD_GRAVITY_m_s2,
)
from lerobot_spacedock.physics.rigid_body import multiply_quaternions, rotate_vector, rotation_vector_to_quaternion

# columns of the sensor array: constant errors of one episode, then standard deviations of its noise
SENSOR_BIAS = 0  # 12: position m, velocity m/s, rotation vector rad, rate rad/s
SENSOR_NOISE = 12  # 4: position m, velocity m/s, rotation vector rad, rate rad/s
SENSOR_RANGE_NOISE = 16  # 1: position noise as a fraction of the range
SENSOR_DIM = 17


@jit
def draw_start(key, bounds, mirror, q_nominal, mass, state, i):
    """Fills ``state[i]`` with a start: see ``InitialConditions.bounds``; ``mirror`` carries it to the port's side."""
    for j in range(3):
        state[i, j] = mirror[j] * uniform_between(key, STREAM_START, j, bounds[0, j], bounds[1, j])
        state[i, 3 + j] = mirror[j] * uniform_between(key, STREAM_START, 3 + j, bounds[0, 3 + j], bounds[1, 3 + j])
        state[i, 11 + j] = uniform_between(key, STREAM_START, 9 + j, bounds[0, 9 + j], bounds[1, 9 + j])
    state[i, 6] = mass
    q = (q_nominal[0], q_nominal[1], q_nominal[2], q_nominal[3])
    for j in range(3):  # intrinsic x-y-z
        half = 0.5 * uniform_between(key, STREAM_START, 6 + j, bounds[0, 6 + j], bounds[1, 6 + j])
        sine = math.sin(half)
        turn = (
            math.cos(half),
            sine if j == 0 else 0.0,
            sine if j == 1 else 0.0,
            sine if j == 2 else 0.0,
        )
        q = multiply_quaternions(q, turn)
    for j in range(4):
        state[i, 7 + j] = q[j]


@jit
def set_nominal_chaser(parameters, i):
    """Fills ``parameters[i]`` with the reference chaser and returns its mass, kg."""
    for j in range(p.PARAMETER_DIM):
        parameters[i, j] = 0.0
    for j in range(3):
        parameters[i, p.INERTIA + 4 * j] = CHASER_INERTIA_kg_m2
        parameters[i, p.INERTIA_INVERSE + 4 * j] = 1.0 / CHASER_INERTIA_kg_m2
        parameters[i, p.THRUST_MAP + 4 * j] = 1.0
        parameters[i, p.TORQUE_MAP + 4 * j] = 1.0
    parameters[i, p.EXHAUST_SPEED] = SPECIFIC_IMPULSE_s * STANDARD_GRAVITY_m_s2
    parameters[i, p.SIMPLE] = 1.0
    return CHASER_MASS_kg


@jit
def draw_chaser(key, ranges, parameters, i):
    """Fills ``parameters[i]`` with a chaser of the meta distribution (``MetaRanges.packed``); returns its mass, kg."""
    set_nominal_chaser(parameters, i)
    mass = CHASER_MASS_kg * (1.0 + uniform_between(key, STREAM_CHASER, 0, -ranges[0], ranges[0]))
    product = ranges[2]
    at = p.INERTIA
    for j in range(3):
        fraction = uniform_between(key, STREAM_CHASER, 1 + j, -ranges[1], ranges[1])
        parameters[i, at + 4 * j] = CHASER_INERTIA_kg_m2 * (1.0 + fraction)
    jxy = uniform_between(key, STREAM_CHASER, 4, -product, product)
    jxz = uniform_between(key, STREAM_CHASER, 5, -product, product)
    jyz = uniform_between(key, STREAM_CHASER, 6, -product, product)
    parameters[i, at + 1] = parameters[i, at + 3] = jxy
    parameters[i, at + 2] = parameters[i, at + 6] = jxz
    parameters[i, at + 5] = parameters[i, at + 7] = jyz
    _invert_symmetric(parameters, i)
    parameters[i, p.SIMPLE] = 0.0
    if jxy == 0.0 and jxz == 0.0 and jyz == 0.0 and ranges[1] == 0.0 and ranges[9] == 0.0:
        parameters[i, p.SIMPLE] = 1.0

    a, b = normal_pair(key, STREAM_CHASER, 50)
    c, _ = normal_pair(key, STREAM_CHASER, 51)
    tilt = rotation_vector_to_quaternion((ranges[7] * a, ranges[7] * b, ranges[7] * c))
    for j in range(3):
        scale = uniform_between(key, STREAM_CHASER, 7 + j, ranges[3], ranges[4])
        axis = (scale if j == 0 else 0.0, scale if j == 1 else 0.0, scale if j == 2 else 0.0)
        column = rotate_vector(tilt, axis)
        for k in range(3):
            parameters[i, p.THRUST_MAP + 3 * k + j] = column[k]
        parameters[i, p.TORQUE_MAP + 4 * j] = uniform_between(key, STREAM_CHASER, 10 + j, ranges[5], ranges[6])
        parameters[i, p.TORQUE_BIAS + j] = uniform_between(key, STREAM_CHASER, 13 + j, -ranges[8], ranges[8])
        parameters[i, p.COM_OFFSET + j] = uniform_between(key, STREAM_CHASER, 16 + j, -ranges[9], ranges[9])
    return mass


@jit
def _invert_symmetric(parameters, i):
    """Inverse of the 3×3 inertia by its adjugate."""
    m, at = parameters, p.INERTIA
    a, b, c = m[i, at], m[i, at + 1], m[i, at + 2]
    d, e, f = m[i, at + 4], m[i, at + 5], m[i, at + 8]
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    scale = 1.0 / (a * aa + b * ab + c * ac)
    at = p.INERTIA_INVERSE
    m[i, at], m[i, at + 1], m[i, at + 2] = scale * aa, scale * ab, scale * ac
    m[i, at + 3], m[i, at + 4], m[i, at + 5] = scale * ab, scale * bb, scale * bc
    m[i, at + 6], m[i, at + 7], m[i, at + 8] = scale * ac, scale * bc, scale * cc


@jit
def draw_sensor(key, ranges, sensor, i):
    """Fills ``sensor[i]``: constant biases of the episode and the noise that each observation draws anew."""
    for group in range(4):
        bias = ranges[10 + group]
        for j in range(3):
            sensor[i, SENSOR_BIAS + 3 * group + j] = uniform_between(key, STREAM_SENSOR, 3 * group + j, -bias, bias)
        sensor[i, SENSOR_NOISE + group] = ranges[14 + group]
    sensor[i, SENSOR_RANGE_NOISE] = ranges[18]


@jit(forceinline=True)
def draw_step(key, index, mean_s, std_s, least_s, most_s):
    """Length of step ``index`` of the episode, s: normal, clipped."""
    value, _ = normal_pair(key, STREAM_STEP, index)
    drawn = mean_s + std_s * value
    drawn = drawn if drawn > least_s else least_s
    return drawn if drawn < most_s else most_s
