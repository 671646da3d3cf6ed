"""The controllers against closed forms, an independent integrator's physics, and the reference's attainable limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.scenario_config import MetaRanges
from lerobot_spacedock.env.speed_profile import SpeedProfile
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert import mpc
from lerobot_spacedock.expert.adaptive import AdaptiveThrust
from lerobot_spacedock.expert.checkpoint import training_counts
from lerobot_spacedock.expert.classical import hill_acceleration
from lerobot_spacedock.expert.controllers import EXPERTS, make_expert
from lerobot_spacedock.expert.deadline import Deadline
from lerobot_spacedock.expert.evaluate import TASKS, VALIDATION_SEED, fly
from lerobot_spacedock.expert.feedback import FeedbackPolicy
from lerobot_spacedock.expert.mpc import MpcPolicy, held_response, plans
from lerobot_spacedock.expert.zem import ZemZevPolicy
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s as N
from lerobot_spacedock.physics.contact import HARMONY_FORWARD, ZVEZDA_AFT

EXAMPLES = Path(__file__).parents[2] / "examples"
SEEDS = range(VALIDATION_SEED, VALIDATION_SEED + 40)


def hcw(_, s, a):
    """HCW as an ODE, written out here: nothing of the package in it."""
    x, _y, z, vx, vy, vz = s
    return [vx, vy, vz, 3 * N * N * x + 2 * N * vy + a[0], -2 * N * vx + a[1], -N * N * z + a[2]]


def integrate(state, acceleration, time):
    return solve_ivp(hcw, (0, time), state, args=(acceleration,), rtol=1e-12, atol=1e-14).y[:, -1]


def test_held_response_is_the_integral_of_the_equations_of_motion():
    for axis in range(3):
        expected = integrate(np.zeros(6), np.eye(3)[axis], 0.9)
        np.testing.assert_allclose(held_response(0.9)[:, axis], expected, atol=1e-12)


def test_hill_acceleration_is_what_free_motion_does():
    state = np.array([3.0, -20.0, 1.0, 0.1, 0.2, -0.3])
    expected = np.array(hcw(0, state, np.zeros(3))[3:])
    np.testing.assert_allclose(hill_acceleration(state[None, :3], state[None, 3:])[0], expected, rtol=1e-13)


def test_mpc_plan_reaches_the_goal_and_no_cheaper_one_does():
    # a plan of 12 steps, flown blind through the ODE; then every perturbation that keeps the end costs more
    steps, dt = 12, 0.9
    state = np.array([0.4, -3.0, -0.2, 0.01, 0.3, 0.0])
    transitions, gains, _ = plans(steps, dt, (1e-9, 1e-9))
    goal = Deadline(closing_speed_m_s=0.075).goal(0.0)
    commands, s = [], state
    for k in range(steps):
        left = steps - k
        commands.append(gains[left - 1] @ (goal - transitions[left - 1] @ s))
        s = integrate(s, commands[-1], dt)
    np.testing.assert_allclose(s, goal, atol=2e-6)
    ends = []
    for k in range(steps):
        for axis in range(3):
            s = np.zeros(6)
            for j in range(steps):
                s = integrate(s, np.eye(3)[axis] * (j == k), dt)
            ends.append(s)
    null = np.linalg.svd(np.array(ends).T)[2][6:]  # changes of the plan that do not move its end
    plan = np.ravel(commands)
    assert np.abs(null @ plan).max() < 1e-7 * np.linalg.norm(plan) * 10


def test_zem_zev_is_the_linear_optimum_of_a_double_integrator(monkeypatch):
    # far from an orbit's curvature: from rest at distance d to rest in T, a(0) = 6 d / T², falling linearly to its
    # negative; the command held over a step is the line's value at the middle of the step
    policy = ZemZevPolicy(Deadline(steps=20, step_s=1.0, closing_speed_m_s=0.0))
    policy.reset(1)
    a = policy.acceleration(np.array([[0.0, -1.0, 0.0]]), np.zeros((1, 3)))[0, 1]
    assert a == pytest.approx(6.0 / 20.0**2 * (1.0 - 1.0 / 20.0), rel=1e-3)


@pytest.mark.parametrize(("name", "smoothest", "roughest"), [("mpc_fixed", 1.3, 1.6), ("zem", 1.4, 1.7)])
def test_fixed_horizon_ends_at_millimetres_as_smoothly_as_the_reference(name, smoothest, roughest):
    flights = fly(make_expert(name, TASKS["fixed same"]), TASKS["fixed same"], SEEDS)
    assert flights.miss_m.mean() < 0.003
    assert flights.miss_m.max() < 0.01
    assert smoothest < flights.smoothness.mean() < roughest


@pytest.mark.parametrize("name", ["mpc", "mpc_fixed", "zem", "W", "V", "Q"])
@pytest.mark.parametrize("port", ["zvezda_aft", "harmony_forward"])
def test_every_controller_docks_at_both_ports(name, port):
    task = TaskConfig(contact=True, hill_coupling=True, max_steps=100, initial_conditions="same_dispersed", port=port)
    flights = fly(make_expert(name, task), task, SEEDS)
    assert flights.idss.all()
    assert flights.miss_m.mean() < 0.015
    assert flights.rate_deg_s.max() < 0.02


def test_law_w_arrives_at_the_speed_that_its_profile_asks_for():
    """0.078 m/s: to 5 mm/s from every start, and to 1 mm/s alike from all."""
    task = TASKS["contact same"]
    closing = fly(make_expert("W", task), task, SEEDS).closing_m_s
    assert np.abs(closing - 0.078).max() < 0.005
    assert np.ptp(closing) < 0.001


@pytest.mark.parametrize(("distance_m", "gain_1_s"), [(0.0, 0.3), (3.0, 0.065 + 0.235 / np.e), (300.0, 0.065)])
def test_law_w_mends_its_closing_speed_faster_near_the_port(distance_m, gain_1_s):
    """From rest, where nothing of the profile's slope or of the orbit acts, it commands gain times wanted speed."""
    wanted_m_s = SpeedProfile().sampled(distance_m, 2)[1]
    command = FeedbackPolicy("W").acceleration(np.array([[0.0, -distance_m, 0.0]]), np.zeros((1, 3)))
    np.testing.assert_allclose(command, [[0.0, gain_1_s * wanted_m_s, 0.0]], rtol=1e-3)


@pytest.mark.parametrize("coupled", [False, True])
def test_attitude_is_held_in_both_attitude_models(coupled):
    task = TaskConfig(max_steps=65, hill_coupling=coupled, initial_conditions="same_dispersed")
    flights = fly(FeedbackPolicy(hill_coupling=coupled), task, SEEDS)
    assert flights.angle_deg.max() < 0.01
    # told the wrong model, the law leaves the orbit's rate times 2 ζ / ω: 0.86 degrees
    wrong = fly(FeedbackPolicy(hill_coupling=not coupled), task, SEEDS)
    assert wrong.angle_deg.mean() == pytest.approx(np.rad2deg(N) * 2.0 / 0.15, rel=0.05)


def test_the_two_ports_are_one_problem_seen_from_two_sides():
    # HCW has no forward and no aft: the same start, turned about the orbit normal, gets the same command, turned
    rng = np.random.default_rng(3)
    observation = np.concatenate(
        [rng.normal((0, -20, 0), 1.0, (5, 3)), 0.1 * rng.normal(size=(5, 3)), np.zeros((5, 4)), np.ones((5, 3))],
        axis=1,
    )
    observation[:, 6:10] = ZVEZDA_AFT.q_nominal
    turned = observation.copy()
    turned[:, [0, 1, 3, 4]] *= -1  # half a turn about z_H
    turned[:, 6:10] = HARMONY_FORWARD.q_nominal
    turned[:, 10:12] *= -1  # and the body rolled by half a turn
    here, there = MpcPolicy(mode="receding"), MpcPolicy(mode="receding", port=HARMONY_FORWARD)
    here.reset(5), there.reset(5)
    expected = here.act(observation) * np.array([-1, -1, 1, -1, -1, 1])
    np.testing.assert_allclose(there.act(turned), expected, atol=1e-12)


@pytest.mark.parametrize("name", ["mpc", "W"])
def test_laws_without_a_clock_do_not_count_steps(name):
    policy = make_expert(name, TASKS["contact same"])
    observation = np.array([[0.3, -12.0, 0.2, 0.0, 0.4, 0.0, *ZVEZDA_AFT.q_nominal, 0.0, 0.0, 0.0]])
    policy.reset(1)
    first = policy.act(observation)
    for _ in range(30):
        again = policy.act(observation)
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("step_s", [0.3, 0.5, 1.8])
def test_free_time_docks_at_the_same_moment_with_steps_of_another_length(step_s):
    # a plan is a time, not a number of steps: the arrival of the reference steps, and in the box
    at_reference = fly(MpcPolicy(mode="receding", hill_coupling=True), TASKS["contact same"], SEEDS)
    task = replace(TASKS["contact same"], time_step="fixed", time_step_mean_s=step_s, max_steps=int(200 / step_s))
    flown = fly(make_expert("mpc", task), task, SEEDS)
    assert flown.idss.all()
    np.testing.assert_allclose(flown.steps * step_s, at_reference.steps * 0.907, rtol=0.15)


def test_free_time_command_is_continuous_in_the_state():
    # the plan's whole number of steps must not show: along a line of states the command never jumps
    distance = np.linspace(2.0, 25.0, 4000)
    states = np.zeros((len(distance), 6))
    states[:, 1], states[:, 4] = -distance, 0.3
    policy = MpcPolicy(mode="receding")
    policy.reset(len(states))
    command = 1000.0 * policy.acceleration(states[:, :3], states[:, 3:])[:, 1]
    assert np.abs(np.diff(command, 2)).max() < 0.2
    assert np.ptp(command) > 30.0
    assert mpc.LONGEST_PLAN_STEPS > 100


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: make_expert("pid", TASKS["fixed same"]), "meta_rl | "),
        (lambda: MpcPolicy(mode="open"), "fixed | receding"),
        (lambda: FeedbackPolicy("X"), "W | V | Q"),
        (lambda: Deadline(steps=0), "deadline.steps: got 0; allowed: a number from 1 to 1e+06"),
        (lambda: Deadline(closing_speed_m_s=-0.1), "from 0 to 1"),
    ],
)
def test_wrong_options_say_what_is_allowed(make, named):
    with pytest.raises(InputError) as error:
        make()
    assert named in str(error.value)


def test_a_controller_of_ones_own_is_an_expert(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    for task in (TASKS["contact random"], replace(TASKS["contact same"], port="harmony_forward")):
        assert fly(make_expert("own_controller:make", task), task, SEEDS).idss.all()
    assert training_counts("own_controller:make") is None  # what trained it is not known
    for name, said in (
        ("nowhere:make", "PYTHONPATH"),
        ("own_controller:nothing", "nothing"),
        ("dataclasses:asdict", "a policy"),
        ("own_controller", "MODULE:FACTORY"),
    ):
        with pytest.raises(InputError, match=said):
            make_expert(name, TaskConfig())


@pytest.mark.parametrize("scale", [0.7, 1.0, 1.2])
def test_the_estimate_is_the_share_of_the_thrust_that_acts(scale):
    """A law that commands at random, through an integrator that knows nothing of the package."""
    rng = np.random.default_rng(0)

    class Random:
        def reset(self, count):
            self.count = count

        def act(self, observation):
            return np.concatenate([rng.uniform(-20.0, 20.0, (self.count, 3)), np.zeros((self.count, 3))], axis=1)

    adaptive = AdaptiveThrust(Random(), step_s=0.9)
    for _ in range(2):  # the second episode begins with nothing of the first
        adaptive.reset(1)
        assert adaptive.scale == 1.0
        state = np.array([1.0, -20.0, 0.5, 0.05, 0.3, -0.05])
        for _ in range(60):
            observation = np.concatenate([state, [1.0, 0.0, 0.0, 0.0], np.zeros(3)])  # body axes are Hill axes
            thrust = adaptive.act(observation[None])[0, :3]
            state = integrate(state, scale * thrust / 1000.0, 0.9)
        assert adaptive.scale[0] == pytest.approx(scale, abs=0.015)  # the prior draws it towards 1


def test_what_is_adapted_to_is_what_acts():
    """Chasers of one mass and of thrusters that are all a fifth too weak, with perfect sensors."""
    weak = MetaRanges(**{name: 0.0 for name in vars(MetaRanges()) if name not in ("thrust_scale", "torque_scale")}
                      | {"thrust_scale": (0.8, 0.8), "torque_scale": (1.0, 1.0)})  # fmt: skip
    task = replace(TASKS["meta random"], meta=weak)
    plain, adaptive = (fly(make_expert(name, task), task, SEEDS) for name in ("mpc", "mpc_adaptive"))
    assert adaptive.idss.all()
    assert np.abs(adaptive.closing_m_s - 0.08).max() < np.abs(plain.closing_m_s - 0.08).max() / 2


@pytest.mark.parametrize("name", EXPERTS)
def test_observations_are_checked(name):
    policy = make_expert(name, TASKS["fixed same"])
    policy.reset(2)
    for wrong, said in [
        (np.zeros((2, 14)), "(2, 14)"),
        (np.zeros((3, 13)), "3 rows"),
        (np.full((2, 13), np.nan), "nan as x"),
    ]:
        with pytest.raises(InputError) as error:
            policy.act(wrong)
        assert said in str(error.value)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("make = 5", "TypeError"),
        ("def make(): return 1", "TypeError"),
        ("make(", "SyntaxError"),
        ("", "AttributeError"),
    ],
)
def test_a_controller_that_cannot_be_made_is_named_with_its_reason(source, said, tmp_path, monkeypatch):
    name = f"own_{abs(hash(source))}"
    (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match=rf"--expert: got {name}:make; allowed: .*a callable.*{said}"):
        make_expert(f"{name}:make", TASKS["fixed same"])
