"""Propagation: closed forms, conserved quantities, fitted order, and DOP853 over whole random episodes."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.chaser import ChaserParameters
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s, SPECIFIC_IMPULSE_s, STANDARD_GRAVITY_m_s2
from lerobot_spacedock.physics.propagate import propagate
from lerobot_spacedock.physics.relative_motion import hcw_transition_matrix

INERTIA = np.array([[520.0, 15.0, -8.0], [15.0, 700.0, 20.0], [-8.0, 20.0, 860.0]])
PERFECT = {"thrust_map": np.eye(3), "torque_map": np.eye(3), "torque_bias": np.zeros(3)}
IMPERFECT = {  # no two numbers equal, so that none stands for another
    "thrust_map": np.array([[0.92, -0.03, 0.02], [0.04, 1.03, -0.05], [-0.01, 0.06, 0.88]]),
    "torque_map": np.array([[0.85, 0.07, -0.02], [-0.04, 1.05, 0.03], [0.01, -0.06, 0.95]]),
    "torque_bias": np.array([0.08, -0.05, 0.1]),
}


def chaser(inertia=None, com_offset=(0.0, 0.0, 0.0), torque_bias=(0.0, 0.0, 0.0), thrust_map=None, torque_map=None):
    nominal = ChaserParameters.nominal()
    return ChaserParameters(
        inertia_kg_m2=nominal.inertia_kg_m2 if inertia is None else np.array(inertia)[None],
        thrust_map=nominal.thrust_map if thrust_map is None else np.array(thrust_map)[None],
        torque_map=nominal.torque_map if torque_map is None else np.array(torque_map)[None],
        torque_bias_Nm=np.array(torque_bias)[None],
        com_offset_m=np.array(com_offset)[None],
        specific_impulse_s=nominal.specific_impulse_s,
    )


def start_state(rng, rate=0.02):
    q = Rotation.random(random_state=np.random.RandomState(rng.integers(2**31))).as_quat(scalar_first=True)
    return np.concatenate([[0.8, -25.0, -0.5], rng.uniform(-0.2, 0.2, 3), [1000.0], q, rng.uniform(-rate, rate, 3)])


def equations(inertia, offset, command, coupling, *, thrust_map, torque_map, torque_bias):
    """Newton, Euler and the rocket, written from the textbook for the centre of mass; rotations by scipy."""
    n = MEAN_MOTION_rad_s
    thrust, torque = thrust_map @ command[:3], torque_map @ command[3:] + torque_bias
    inverse = np.linalg.inv(inertia)
    flow = np.linalg.norm(thrust) / (SPECIFIC_IMPULSE_s * STANDARD_GRAVITY_m_s2)

    def rates(_, s):
        r, v, m, q, w = s[:3], s[3:6], s[6], s[7:11], s[11:14]
        a = Rotation.from_quat(q, scalar_first=True).apply(thrust) / m
        gravity = [3 * n**2 * r[0] + 2 * n * v[1], -2 * n * v[0], -(n**2) * r[2]]
        omega = w
        if coupling:  # body rate relative to the turning Hill frame
            omega = w - Rotation.from_quat(q, scalar_first=True).inv().apply([0.0, 0.0, n])
        qv = q[1:]
        qdot = 0.5 * np.concatenate([[-qv @ omega], q[0] * omega + np.cross(qv, omega)])
        wdot = inverse @ (torque + np.cross(-np.asarray(offset), thrust) - np.cross(w, inertia @ w))
        return np.concatenate([v, gravity + a, [-flow], qdot, wdot])

    return rates


def moved_point(state, arm, coupling):
    """The same motion seen at a point ``arm`` (body axes) from the given one."""
    turn = Rotation.from_quat(state[7:11], scalar_first=True)
    omega = state[11:14] - (turn.inv().apply([0, 0, MEAN_MOTION_rad_s]) if coupling else 0.0)
    out = state.copy()
    out[:3] += turn.apply(arm)
    out[3:6] += turn.apply(np.cross(omega, arm))
    return out


@pytest.mark.parametrize("coupling", [False, True])
@pytest.mark.parametrize(
    ("inertia", "offset", "actuators"),
    [
        (np.eye(3) * 2000 / 3, np.zeros(3), PERFECT),
        (np.eye(3) * 2000 / 3, np.zeros(3), IMPERFECT),
        (INERTIA, np.zeros(3), PERFECT),
        (INERTIA, np.array([0.02, -0.015, 0.03]), IMPERFECT),
    ],
    ids=["reference", "imperfect_actuators", "full_inertia", "offset_centre_of_mass"],
)
def test_whole_random_episodes_agree_with_dop853(inertia, offset, actuators, coupling):
    """65 steps of random full-scale commands, which tumble the chaser as no docking does; 15 that hardly turn it."""
    parameters = chaser(inertia, offset, **actuators)
    for count, rate, torque in ((65, 0.02, 20.0), (15, 0.002, 0.3)):
        rng = np.random.default_rng(7)
        state = start_state(rng, rate)
        reference = moved_point(state, offset, coupling)
        for _ in range(count):
            action = rng.uniform(-1, 1, 6) * [60, 60, 60, torque, torque, torque]
            dt = rng.uniform(0.6, 1.25)
            state = propagate(state[None], action[None], dt, parameters, hill_coupling=coupling)[0]
            rates = equations(inertia, offset, action, coupling, **actuators)
            reference = solve_ivp(rates, (0, dt), reference, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        expected = moved_point(reference, -offset, coupling)
        turn = Rotation.from_quat(expected[7:11], scalar_first=True).inv() * Rotation.from_quat(
            state[7:11], scalar_first=True
        )
        assert np.linalg.norm(state[:3] - expected[:3]) < 1e-6  # m
        assert np.linalg.norm(state[3:6] - expected[3:6]) < 1e-7  # m/s
        assert abs(state[6] - expected[6]) < 1e-9  # kg
        assert turn.magnitude() < 1e-8  # rad
        assert np.linalg.norm(state[11:] - expected[11:]) < 1e-9  # rad/s
        assert abs(np.linalg.norm(state[7:11]) - 1.0) < 1e-14


@pytest.mark.parametrize("step_s", [10.0, 100.0, 600.0])
def test_a_long_step_of_a_quiet_chaser_is_as_exact(step_s):
    """Nothing turns but the orbit: also that is cut into substeps."""
    state = np.array([0.0, -25.0, 0.0, 0.0, 0.0, 0.0, 1000.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    action = np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    got = propagate(state[None], action[None], step_s, chaser())[0]
    rates = equations(np.eye(3), np.zeros(3), action, False, **PERFECT)
    exact = solve_ivp(rates, (0, step_s), state, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert np.linalg.norm(got[:3] - exact[:3]) < 1e-8 * np.linalg.norm(exact[:3] - state[:3])


def test_order_of_convergence_is_four():
    rng = np.random.default_rng(3)
    state = start_state(rng, rate=0.3)
    action = np.array([40.0, -30.0, 20.0, 15.0, -10.0, 12.0])
    parameters = chaser(INERTIA, (0.05, 0.02, -0.04))
    counts = np.array([1, 2, 4, 8, 16])
    exact = propagate(state[None], action[None], 4.0, parameters, substeps=512)[0]
    parts = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(7, 11), "rate": slice(11, 14)}
    for name, part in parts.items():
        errors = [
            np.linalg.norm(
                propagate(state[None], action[None], 4.0, parameters, substeps=int(k))[0][part] - exact[part]
            )
            for k in counts
        ]
        order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
        assert 3.7 < order < 5.2, f"{name}: order {order:.2f}, errors {errors}"


def test_free_flight_is_the_hcw_transition():
    state = start_state(np.random.default_rng(0))
    out = propagate(state[None], np.zeros((1, 6)), 50.0, chaser())[0]
    assert np.allclose(out[:6], hcw_transition_matrix(50.0, MEAN_MOTION_rad_s) @ state[:6], rtol=0, atol=1e-12)
    assert out[6] == state[6]


def test_torque_free_symmetric_top_precesses_in_closed_form():
    """Axisymmetric J = (A, A, C): transverse rate turns about body z at (C - A)/A * w3; L is fixed in space."""
    a, c, w3, transverse, time = 600.0, 900.0, 0.4, 0.1, 30.0
    state = np.concatenate([np.zeros(6), [1000.0], [1, 0, 0, 0], [transverse, 0.0, w3]])
    out = propagate(state[None], np.zeros((1, 6)), time, chaser(np.diag([a, a, c])))[0]
    lam = (c - a) / a * w3
    expected = [transverse * np.cos(lam * time), transverse * np.sin(lam * time), w3]
    assert np.allclose(out[11:], expected, atol=2e-8)
    # attitude: precession about L composed with spin about body z
    momentum = np.array([a * transverse, 0.0, c * w3])
    precession = Rotation.from_rotvec(momentum / a * time)
    spin = Rotation.from_rotvec([0.0, 0.0, -lam * time])
    error = (precession * spin).inv() * Rotation.from_quat(out[7:11], scalar_first=True)
    assert error.magnitude() < 1e-7


def test_torque_free_motion_conserves_momentum_and_energy():
    rng = np.random.default_rng(5)
    state = start_state(rng, rate=0.2)
    parameters = chaser(INERTIA)

    def conserved(s):
        momentum = Rotation.from_quat(s[7:11], scalar_first=True).apply(INERTIA @ s[11:])
        return np.append(momentum, 0.5 * s[11:] @ INERTIA @ s[11:])

    before = conserved(state)
    for _ in range(200):
        state = propagate(state[None], np.zeros((1, 6)), 0.9, parameters)[0]
    assert np.allclose(conserved(state), before, rtol=1e-7, atol=1e-7 * np.linalg.norm(before[:3]))


def test_mass_and_speed_obey_the_rocket_equation():
    state = np.concatenate([np.zeros(6), [1000.0], [1, 0, 0, 0], np.zeros(3)])
    action = np.array([[0.0, 0.0, 60.0, 0.0, 0.0, 0.0]])  # along z: HCW couples nothing into it but -n² z
    out = propagate(state[None], action, 20.0, chaser(), mean_motion_rad_s=1e-9)[0]
    exhaust = SPECIFIC_IMPULSE_s * STANDARD_GRAVITY_m_s2
    assert out[6] == pytest.approx(1000.0 - 60.0 / exhaust * 20.0, abs=1e-12)
    assert out[5] == pytest.approx(exhaust * np.log(1000.0 / out[6]), abs=1e-12)


def test_constant_spin_and_hill_turn_are_exact():
    state = np.concatenate([np.zeros(6), [1000.0], [1, 0, 0, 0], [0.0, 0.0, 0.05]])
    out = propagate(state[None], np.zeros((1, 6)), 100.0, chaser(), hill_coupling=True)[0]
    half = 0.5 * (0.05 - MEAN_MOTION_rad_s) * 100.0
    expected = Rotation.from_rotvec([0, 0, 2 * half])
    assert (expected.inv() * Rotation.from_quat(out[7:11], scalar_first=True)).magnitude() < 1e-12


def test_misaligned_and_scaled_thrust_is_what_acts():
    tilt = Rotation.from_rotvec([0.0, 0.0, 0.1]).as_matrix() * 0.9
    state = np.concatenate([np.zeros(6), [1000.0], [1, 0, 0, 0], np.zeros(3)])
    action = np.array([[10.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    out = propagate(state[None], action, 1e-3, chaser(thrust_map=tilt), mean_motion_rad_s=1e-9)[0]
    assert np.allclose(out[3:6] / 1e-3, 0.009 * np.array([np.cos(0.1), np.sin(0.1), 0.0]), atol=1e-9)


def test_batch_rows_threads_and_order_change_nothing():
    rng = np.random.default_rng(11)
    states = np.array([start_state(rng) for _ in range(40)])
    actions = rng.uniform(-1, 1, (40, 6)) * [60, 60, 60, 20, 20, 20]
    steps = rng.uniform(0.6, 1.25, 40)
    whole = propagate(states, actions, steps, chaser(INERTIA))
    threaded = propagate(states, actions, steps, chaser(INERTIA), threads=2)
    backwards = propagate(states[::-1], actions[::-1], steps[::-1], chaser(INERTIA))[::-1]
    single = np.concatenate(
        [propagate(states[i : i + 1], actions[i : i + 1], steps[i], chaser(INERTIA)) for i in range(40)]
    )
    for other in (threaded, backwards, single):
        assert np.array_equal(whole, other)


def test_bad_input_is_named():
    state, action = np.zeros((2, 14)), np.zeros((2, 6))
    with pytest.raises(InputError, match=r"action: got shape \(1, 6\)"):
        propagate(state, action[:1], 0.9, chaser())
    with pytest.raises(InputError, match="state: got shape"):
        propagate(state[:, :13], action, 0.9, chaser())
    with pytest.raises(InputError, match="positive definite"):
        chaser(np.diag([1.0, -1.0, 1.0])).pack()
    with pytest.raises(InputError, match="3 rows"):
        propagate(state, action, 0.9, ChaserParameters.nominal(3))


def test_a_chaser_flies_the_same_whatever_flies_beside_it():
    # a block of reference chasers, odd inertias, offset centres of mass, tumbling ones: each as it flies alone
    generator = np.random.default_rng(7)
    count = 100
    state = np.zeros((count, 14))
    state[:, :6] = generator.normal(size=(count, 6)) * [5, 5, 5, 0.2, 0.2, 0.2]
    state[:, 6] = generator.uniform(900, 1100, count)
    q = generator.normal(size=(count, 4))
    state[:, 7:11] = q / np.linalg.norm(q, axis=1, keepdims=True)
    state[:, 11:] = generator.normal(size=(count, 3)) * generator.choice([0.001, 0.1], (count, 1))
    action = generator.uniform(-1, 1, (count, 6)) * [60, 60, 60, 20, 20, 20]
    step_s = generator.uniform(0.0, 2.0, count)
    nominal = ChaserParameters.nominal(count)
    inertia, offset = nominal.inertia_kg_m2.copy(), nominal.com_offset_m.copy()
    odd, off_centre = generator.random(count) < 0.5, generator.random(count) < 0.3
    inertia[odd] += np.diag([10.0, 20.0, 30.0])
    offset[off_centre] = generator.normal(size=(off_centre.sum(), 3)) * 0.05
    chaser = dataclasses.replace(nominal, inertia_kg_m2=inertia, com_offset_m=offset).pack()
    for coupling in (False, True):
        together = propagate(state, action, step_s, chaser, hill_coupling=coupling)
        for i in range(count):
            row = slice(i, i + 1)
            alone = propagate(state[row], action[row], step_s[row], chaser[row], hill_coupling=coupling)
            assert np.array_equal(alone[0], together[i])
        reverse = propagate(state[::-1], action[::-1], step_s[::-1], chaser[::-1].copy(), hill_coupling=coupling)
        assert np.array_equal(reverse[::-1], together)
