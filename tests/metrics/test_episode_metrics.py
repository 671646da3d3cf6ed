"""Per-episode metrics against closed forms and hand-made logs."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lerobot_spacedock.episode_log import EpisodeLog, log_path, write_episode_log
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics.catalog import CATALOG, NAMES
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.metrics.crossing import closest_approach, plane_crossing, range_rate
from lerobot_spacedock.metrics.effort import effort
from lerobot_spacedock.metrics.episode import CONTACT_NUMBERS, IDSS_CONDITIONS, corridor_margin, episode_metrics
from lerobot_spacedock.metrics.smoothness import smoothness
from lerobot_spacedock.metrics.visitation import CELL_M, count_cells, density, merge
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import HARMONY_FORWARD, ZVEZDA_AFT
from lerobot_spacedock.physics.rotations import multiply

NOMINAL = np.array([math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0])


def make_log(y, *, vy=None, x=0.0, dt=1.0, action=None, mass=1000.0, metadata=None, q=NOMINAL, w=(0.0, 0.0, 0.0)):
    y = np.asarray(y, dtype=float)
    vy = np.gradient(y, dt) if vy is None else np.broadcast_to(np.asarray(vy, float), y.shape)
    state = np.zeros((len(y), 14))
    state[:, 0], state[:, 1], state[:, 4], state[:, 6] = x, y, vy, mass
    state[:, 7:11], state[:, 11:] = q, w
    steps = len(y) - 1
    action = np.zeros((steps, 6)) if action is None else np.asarray(action, float)
    time = dt * np.arange(len(y))
    return EpisodeLog(time, state, action, np.full(steps, dt), np.zeros(steps), metadata or {})


def test_crossing_is_exact_for_constant_acceleration():
    y0, v0, a, dt = -1.0, 0.1, 0.05, 0.9
    t = dt * np.arange(9)
    log = make_log(y0 + v0 * t + 0.5 * a * t**2, vy=v0 + a * t, dt=dt)
    time, state = plane_crossing(log.time, log.state, ZVEZDA_AFT)
    exact = (-v0 + math.sqrt(v0**2 - 2 * a * y0)) / a
    assert time == pytest.approx(exact, abs=1e-9)
    assert state[4] == pytest.approx(v0 + a * exact, abs=1e-9)
    assert state[1] == pytest.approx(0.0, abs=1e-9)


def test_crossing_knows_from_which_side_the_port_is_approached():
    log = make_log([-1.0, 1.0])
    assert plane_crossing(log.time, log.state, ZVEZDA_AFT) is not None
    assert plane_crossing(log.time, log.state, HARMONY_FORWARD) is None
    back = make_log([1.0, -1.0])
    assert plane_crossing(back.time, back.state, HARMONY_FORWARD)[0] == pytest.approx(0.5)
    assert plane_crossing(log.time, make_log([-2.0, -1.0]).state, ZVEZDA_AFT) is None


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 3.0), st.floats(-5, 5), st.floats(0.1, 10))
def test_closest_approach_of_a_straight_line_is_its_distance(miss, angle, length):
    direction = np.array([math.cos(angle), math.sin(angle), 0.0])
    across = np.array([-direction[1], direction[0], 0.0])
    path = miss * across + np.array([[-length], [2 * length]]) * direction
    assert closest_approach(path) == pytest.approx(miss, abs=1e-9)
    assert closest_approach(path[:1]) == pytest.approx(math.hypot(miss, length))


def test_range_rate_is_the_derivative_of_range():
    t = np.linspace(0, 1, 2001)
    position = np.stack([1 + t, -5 + 2 * t**2, 0.3 * t], axis=1)
    velocity = np.stack([np.ones_like(t), 4 * t, 0.3 * np.ones_like(t)], axis=1)
    distance, rate = range_rate(position, velocity)
    assert rate[1:-1] == pytest.approx(np.gradient(distance, t)[1:-1], abs=1e-5)
    assert range_rate(np.zeros((1, 3)), np.array([[0.0, 3.0, 4.0]]))[1] == pytest.approx([-5.0])


def test_smoothness_is_the_mean_norm_of_differences():
    action = np.array([[0, 0, 0, 0, 0, 0], [3, 0, 0, 0, 4, 0], [3, 0, 0, 0, 4, 12.0]])
    numbers = smoothness(action, np.array([0.5, 0.5, 9.0]))
    assert numbers["smoothness"] == pytest.approx((5 + 12) / 2)
    assert numbers["smoothness_thrust_N"] == pytest.approx(1.5)
    assert numbers["smoothness_torque_Nm"] == pytest.approx(8.0)
    assert numbers["smoothness_per_limit"] == pytest.approx((math.hypot(3 / 60, 4 / 20) + 12 / 20) / 2)
    assert numbers["smoothness_thrust_N_s"] == pytest.approx(3.0)  # the last command's length does not count
    assert set(smoothness(action[:1], np.ones(1)).values()) == {None}


def test_change_per_second_does_not_depend_on_the_step_length():
    ramp = np.linspace(0, 10, 11)[:, None] * np.ones(6)
    fine = np.linspace(0, 10, 101)[:, None] * np.ones(6)
    coarse = smoothness(ramp, np.full(11, 1.0))["smoothness_thrust_N_s"]
    assert smoothness(fine, np.full(101, 0.1))["smoothness_thrust_N_s"] == pytest.approx(coarse)
    assert smoothness(fine, np.full(101, 0.1))["smoothness"] == pytest.approx(
        smoothness(ramp, np.full(11, 1.0))["smoothness"] / 10
    )


def test_delta_v_obeys_the_rocket_equation():
    exhaust, thrust, dt = 300.0 * 9.81, np.array([[40.0, 0, 0]] * 60), np.full(60, 0.9)
    mass = 1000.0 - np.concatenate([[0.0], np.cumsum(40.0 * dt / exhaust)])
    found = effort(np.pad(thrust, ((0, 0), (0, 3))), dt, mass)["delta_v_m_s"]
    assert found == pytest.approx(exhaust * math.log(mass[0] / mass[-1]), rel=1e-9)


def test_effort_states_what_the_log_did_not_track():
    action = np.array([[30.0, 40.0, 0, 0, 0, 2.0], [0, 0, 60.0, 0, 0, 0]])
    numbers = effort(action, np.array([1.0, 2.0]), np.full(3, 1000.0))
    assert numbers["propellant_kg"] is None
    assert numbers["impulse_N_s"] == 50 + 120
    assert numbers["angular_impulse_N_m_s"] == 2
    assert (numbers["peak_thrust_N"], numbers["saturated_share"]) == (60, 0.5)
    nothing = effort(np.zeros((0, 6)), np.zeros(0), np.full(1, 1000.0))
    assert (nothing["delta_v_m_s"], nothing["propellant_kg"], nothing["saturated_share"]) == (0.0, 0.0, 0.0)


@pytest.mark.filterwarnings("error")
def test_a_log_without_a_mass_has_no_delta_v():
    numbers = effort(np.ones((2, 6)), np.ones(2), np.zeros(3))
    assert numbers["delta_v_m_s"] is None
    assert numbers["propellant_kg"] is None
    assert numbers["impulse_N_s"] == pytest.approx(2 * math.sqrt(3))


def test_good_docking_and_each_way_to_spoil_it():
    def flags(**options):
        return episode_metrics(make_log(np.array([-0.2, -0.13, -0.06, 0.01]), vy=0.07, **options))

    good = flags()
    assert good["idss"]
    assert good["atv"]
    assert good["success"]
    assert good["crossed"]
    assert not good["fly_through"]
    assert good["crossing_time_s"] == pytest.approx(0.2 / 0.07, abs=1e-6)
    assert good["closing_speed_m_s"] == pytest.approx(0.07)
    wide = flags(x=0.11)
    assert not wide["idss_lateral"]
    assert not wide["idss"]
    assert not wide["atv"]
    assert wide["fly_through"]
    rolled = flags(q=multiply(NOMINAL, np.array([math.cos(0.05), 0, 0, math.sin(0.05)])))  # 5.7° about the port axis
    assert not rolled["idss_roll"]
    assert rolled["idss_pitch_yaw"]
    tilted = flags(q=multiply(NOMINAL, np.array([math.cos(0.05), math.sin(0.05), 0, 0])))
    assert tilted["idss_roll"]
    assert not tilted["idss_pitch_yaw"]
    spinning = flags(w=(0.0, 0.0, 0.25))
    assert not spinning["idss_roll_rate"]
    assert spinning["idss_pitch_yaw_rate"]
    assert spinning["atv"]
    fast = episode_metrics(make_log(np.array([-0.5, -0.3, -0.1, 0.1]), vy=0.2))
    assert not fast["idss_closing_speed"]
    assert fast["idss_lateral"]
    assert fast["fly_through"]


def test_an_episode_that_never_crosses_is_judged_at_its_last_state_with_its_whole_distance():
    near = episode_metrics(make_log([-0.2, -0.12, -0.05], vy=0.07))
    short = episode_metrics(make_log([-0.5, -0.4, -0.3], vy=0.07))
    assert not near["crossed"]
    assert near["idss"]
    assert not near["fly_through"]
    assert near["crossing_time_s"] is None
    assert not short["idss_lateral"]
    assert not short["idss"]
    assert short["final_distance_m"] == pytest.approx(0.3)


@pytest.mark.parametrize(("x", "flew_through"), [(0.0, False), (0.12, True)])
def test_who_met_the_box_at_the_plane_did_not_fly_through_it(x, flew_through):
    """A task of fixed length judges its last state: behind the plane, and here too far behind it."""
    y = np.array([-0.2, -0.13, -0.06, 0.01, 0.08, 0.15])
    last = {**dict.fromkeys(CONTACT_NUMBERS, 0.0), **dict.fromkeys(IDSS_CONDITIONS, True), "axial_m": -0.15}
    last |= {"idss": False, "idss_lateral": False}
    flown = episode_metrics(make_log(y, vy=0.07, x=x, metadata={"config": {"contact": False}, "contact": last}))
    assert flown["crossed"]
    assert not flown["idss"]
    assert flown["fly_through"] is flew_through


def test_who_hovers_before_the_port_has_not_docked_where_the_task_is_to_touch_it():
    contact = {"config": {"contact": True, "hill_coupling": True}}
    hover = episode_metrics(make_log([-0.2, -0.12, -0.05], vy=0.07, metadata=contact))
    assert not hover["idss"]
    assert not hover["atv"]
    assert not hover["success"]
    assert hover["idss_lateral"], "the conditions one by one are of the last state"
    assert hover["lateral_m"] is None
    assert hover["closing_speed_m_s"] is None
    assert hover["final_closing_m_s"] == pytest.approx(0.07)


def test_the_rate_at_the_end_is_against_the_station():
    turning = math.degrees(MEAN_MOTION_rad_s)  # about the orbit normal, −y of the body at the nominal attitude
    coupled = {"config": {"hill_coupling": True}}
    stands_still = make_log([-0.2, -0.1], w=(0.0, -turning, 0.0), metadata=coupled)
    assert episode_metrics(stands_still)["final_rate_deg_s"] == pytest.approx(0.0, abs=1e-12)
    alone = make_log([-0.2, -0.1], w=(0.0, -turning, 0.0))
    assert episode_metrics(alone)["final_rate_deg_s"] == pytest.approx(turning)


def test_what_the_log_states_of_its_contact_comes_first():
    stated = episode_metrics(make_log([-0.2, 0.1], vy=0.3))
    contact = {name: stated[name] for name in stated if name in NAMES or name.startswith(("idss", "atv"))}
    contact |= {"axial_m": 0.0, "lateral_m": 0.033, "idss": True}
    told = episode_metrics(make_log([-0.2, 0.1], vy=0.3, metadata={"contact": contact, "success": False}))
    assert told["lateral_m"] == 0.033
    assert told["idss"]
    assert told["success"] is False


@pytest.mark.parametrize("column", ["time", "dt"])
def test_an_episode_whose_time_runs_back_is_left_out_by_name(tmp_path, column):
    log = make_log([-3.0, -2.0, -1.0])
    values = getattr(log, column).copy()
    values[1] = -0.5
    write_episode_log(log_path(tmp_path, 1), dataclasses.replace(log, **{column: values}))
    write_episode_log(log_path(tmp_path, 2), log)
    sets, (left_out,) = collect([sorted(tmp_path.iterdir())], workers=1)
    assert sets["unspecified"].names == ["episode_000002.parquet"]
    assert re.search(rf"{column}: got a step of -\d.* in row \d", left_out.reason)


def test_an_episode_of_one_state_has_every_name_and_no_nan():
    numbers = episode_metrics(make_log([-25.0], vy=0.0))
    assert list(numbers)[: len(NAMES)] == list(NAMES)
    assert numbers["smoothness"] is None
    assert numbers["steps"] == 0
    assert all(v is None or math.isfinite(v) for v in numbers.values())


def test_misalignment_does_not_depend_on_the_sign_or_length_of_the_quaternion():
    half = math.radians(1.5)
    axis = np.array([0.6, 0.0, 0.8])
    turn = np.array([math.cos(half), *(math.sin(half) * axis)])
    w, v = NOMINAL[0], NOMINAL[1:]
    q = np.array([w * turn[0] - v @ turn[1:], *(w * turn[1:] + turn[0] * v + np.cross(v, turn[1:]))])
    for scale in (1.0, -1.0, 1.001):
        assert episode_metrics(make_log([-3.0, -2.0], q=scale * q))["final_misalignment_deg"] == pytest.approx(3.0)


def test_corridor_is_a_cone_with_a_mouth():
    position = np.array([[1.4, 0.0, 0.0], [1.6, 0.0, 0.0], [0, -10.0, 3.2], [0, -10.0, 3.3], [0, 2.0, 1.6]])
    inside = corridor_margin(position, ZVEZDA_AFT, math.radians(10.0), 1.5) >= 0
    assert list(inside) == [True, False, True, False, False]
    narrow = {"config": {"corridor": {"half_angle_deg": 1.0, "mouth_radius_m": 0.1}}}
    assert episode_metrics(make_log([-10.0, -9.0], x=0.5, metadata=narrow))["corridor_violated"]
    assert not episode_metrics(make_log([-10.0, -9.0], x=0.5))["corridor_violated"]


def test_visitation_density_integrates_to_one_and_does_not_mind_the_order():
    rng = np.random.default_rng(0)
    y, x = rng.normal(-5, 1.0, 4000), rng.normal(0, 0.5, 4000)
    whole = count_cells(y, x)
    parts = merge(count_cells(y[:1500], x[:1500]), count_cells(y[1500:], x[1500:]))
    assert np.array_equal(whole.cells, parts.cells)
    assert np.array_equal(whole.counts, parts.counts)
    ys, xs, grid = density(whole, (-15, 5), (-5, 5))
    assert grid.shape == (len(xs), len(ys))
    assert grid.sum() * CELL_M**2 == pytest.approx(1.0, abs=1e-6)
    assert (grid * ys).sum() * CELL_M**2 == pytest.approx(y.mean(), abs=CELL_M)
    # a Gaussian stays one under smoothing: variances add, and the cell's own width
    spread = (grid * (xs[:, None] - x.mean()) ** 2).sum() * CELL_M**2
    assert spread == pytest.approx(x.var() + 0.2**2 + CELL_M**2 / 12, rel=0.02)


def test_visits_far_outside_are_counted_apart():
    cells = count_cells(np.array([0.0, 500.0]), np.array([0.0, 0.0]))
    assert (cells.outside, cells.total) == (1, 2)
    assert density(cells, (-1, 1), (-1, 1))[2].sum() * CELL_M**2 == pytest.approx(0.5, abs=0.01)


def test_the_documentation_lists_every_metric():
    text = (Path(__file__).parents[2] / "docs" / "metrics.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]+) \|$", text, flags=re.M)
    assert listed == [(metric.name, metric.meaning) for metric in CATALOG]


def test_saturation_is_of_the_chasers_own_limits():
    log = make_log(np.linspace(-10.0, -1.0, 5), action=np.full((4, 6), 15.0))
    weak = dataclasses.replace(log, metadata={"config": {"thrust_limit_N": 15.0, "torque_limit_Nm": 30.0}})
    assert episode_metrics(log)["saturated_share"] == 0.0
    assert episode_metrics(weak)["saturated_share"] == 1.0
    for wrong in (0, -1.0, "strong", None):
        with pytest.raises(InputError, match="thrust_limit_N"):
            episode_metrics(dataclasses.replace(log, metadata={"config": {"thrust_limit_N": wrong}}))


def test_episodes_of_two_tasks_are_no_run(tmp_path):
    for seed, task in enumerate(("SpaceDock-v0", "SpaceDockContact-v0")):
        log = make_log(np.linspace(-10.0, -1.0, 5), metadata={"env_id": task, "seed": seed})
        write_episode_log(log_path(tmp_path, seed), log)
    with pytest.raises(InputError, match=r"SpaceDock-v0 .*SpaceDockContact-v0 .*one task a run"):
        collect([sorted(tmp_path.glob("*.parquet"))])
