"""Recorded episodes fly again; logs hold what was flown."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import lerobot_spacedock  # noqa: F401
from lerobot_spacedock.env import ENV_IDS
from lerobot_spacedock.env.start import check_start, check_time_steps
from lerobot_spacedock.episode_log import log_path, read_episode_log
from lerobot_spacedock.errors import InputError, SimulationError, SpaceDockError


def make(env_id="SpaceDock-v0", **options):
    return gym.make(env_id, obs_type="agent_pos", disable_env_checker=True, **options)


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_a_logged_episode_flies_again_within_a_millimetre(env_id, tmp_path):
    env = make(env_id, log_dir=str(tmp_path), initial_conditions="random", label="random commands")
    env.reset(seed=42)
    rng, done = np.random.default_rng(0), False
    while not done:
        _, _, terminated, truncated, info = env.step((rng.uniform(-1, 1, 6) * [20, 20, 20, 1, 1, 1]).astype(np.float32))
        done = terminated or truncated
    log = read_episode_log(log_path(tmp_path, 42))
    assert log.metadata["env_id"] == env_id
    assert log.metadata["seed"] == 42
    assert log.metadata["label"] == "random commands"
    assert log.metadata["outcome"] == info["outcome"]
    assert np.allclose(np.diff(log.time), log.dt, atol=1e-12)
    assert log.reward.shape == (log.num_steps,)

    again = make(env_id, initial_conditions="same")
    # float32, as a dataset would hold it
    again.reset(seed=42, options={"state": np.float32(log.state[0]), "time_steps": log.dt})
    for action in log.action:
        _, _, terminated, truncated, info = again.step(action)
    assert terminated or truncated
    assert np.linalg.norm(info["state"][:3] - log.state[-1, :3]) < 1e-3
    assert info["outcome"] == log.metadata["outcome"]


def test_clipping_is_counted_not_silent(tmp_path):
    env = make(log_dir=str(tmp_path), max_steps=3)
    env.reset(seed=1)
    env.step(np.array([100.0, 0, 0, 0, 0, 0]))
    env.step(np.array([0.0, 0, 0, 0, -30.0, 0]))
    *_, info = env.step(np.array([59.0, 0, 0, 0, 0, 0]))
    assert info["clipped_actions"] == 2
    log = read_episode_log(log_path(tmp_path, 1))
    assert log.metadata["clipped_actions"] == 2
    assert log.action[0, 0] == 60.0
    assert log.action[1, 4] == -20.0


def test_the_largest_action_of_the_space_is_not_clipped():
    env = make(thrust_limit_N=33.4, torque_limit_Nm=0.1)  # both a little larger in single precision
    env.reset(seed=1)
    *_, info = env.step(env.action_space.high)
    assert info["clipped_actions"] == 0
    *_, info = env.step(np.nextafter(env.action_space.high, np.float32(np.inf)))
    assert info["clipped_actions"] == 1


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([np.nan, 0, 0, 0, 0, 0], "got nan .*column 0.* finite"),
        ([0, 0, np.inf, 0, 0, 0], "got inf"),
        ([0, 0, 0], r"got shape \(3,\)"),
        ("push", "6 numbers"),
        ([None] * 6, "finite|6 numbers"),
        ([10**400, 0, 0, 0, 0, 0], "6 numbers"),
    ],
)
def test_bad_actions_are_refused_and_the_episode_goes_on(action, message):
    env = make()
    env.reset(seed=0)
    with pytest.raises(InputError, match=message):
        env.step(action)
    env.step(np.zeros(6))


def test_what_breaks_an_episode_or_its_start_ends_it():
    env = make()
    env.reset(seed=3, options={"state": [*GOOD_START[:6], 1e-3, *GOOD_START[7:]]})  # a gram of a chaser
    with pytest.raises(SimulationError, match=r"seed 3, row 0, step 1: .*no mass"):
        env.step([60.0] * 6)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(6))
    env.reset(seed=3)
    with pytest.raises(InputError):
        env.reset(seed=4, options={"state": [1.0]})
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(6))
    env.reset(seed=3)
    env.step(np.zeros(6))


GOOD_START = [0, -25, 0, 0, 0, 0, 1000, 1, 0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"state": [0.0] * 12}, "14 values"),
        ({"state": [*GOOD_START[:7], 0, 0, 0, 0, 0, 0, 0]}, "unit quaternion"),
        ({"state": [*GOOD_START[:6], -5.0, *GOOD_START[7:]]}, "mass > 0"),
        ({"state": [np.nan, *GOOD_START[1:]]}, "x = nan"),
        ({"state": [10**400, *GOOD_START[1:]]}, "allowed: numbers"),
        ({"time_steps": []}, "at least one"),
        ({"time_steps": [0.9, -0.1]}, "index 1"),
        ({"time_steps": [[0.9]]}, "one dimension"),
        ({"stat": GOOD_START}, "stat.*time_steps"),
    ],
)
def test_bad_reset_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        make().reset(options=options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"obs_typ": "agent_pos"}, "obs_typ.*obs_type"),
        ({"port": "zarya"}, "zvezda_aft"),
        ({"camera": {"heigth": 3}}, r"camera\.heigth.*height"),
        ({"max_steps": 0}, "integer ≥ 1"),
        ({"reward": {"scale": float("nan")}}, r"reward\.scale: got nan; allowed: a finite number ≥ 0"),
        ({"reward": {"rate_scale_deg_s": 0.0}}, r"reward\.rate_scale_deg_s: got 0\.0; allowed: a finite number > 0"),
        ({"corridor": {"half_angle_deg": -1.0}}, r"corridor\.half_angle_deg"),
        ({"meta": {"thrust_scale": (1.1, 0.9)}}, r"meta\.thrust_scale: .*least and most"),
        ({"meta": {"thrust_scale": [1.1, 0.9]}}, r"meta\.thrust_scale: .*least and most"),
        ({"meta": {"thrust_scale": 0.9}}, r"meta\.thrust_scale: .*least and most"),
        ({"corridor": {"half_angle_deg": 95.0}}, r"corridor\.half_angle_deg: got 95"),
        ({"corridor": {"enabled": "false"}}, r"corridor\.enabled: got false; allowed: True \| False"),
        ({"with_mass": "false"}, r"with_mass: got false; allowed: True \| False"),
        ({"reward": {"cruise_speed_m_s": 0.05}}, r"reward\.cruise_speed_m_s: .*reward\.closing_speed_m_s \(0\.075\)"),
        ({"reward": {"alive": "3"}}, r"reward\.alive: got 3; allowed: a finite number ≥ 0"),
        ({"reward": 3}, r"env\.reward: got 3; allowed: a dict .*braking_power"),
        ({"time_step_mean_s": "1"}, r"time_step_mean_s: got 1; allowed: a finite number > 0"),
        ({"time_step_mean_s": 2.0}, r"time_step_mean_s: got 2\.0; .*0\.6 to 1\.25 s.* time_step=fixed"),
        ({"time_step_mean_s": 0.5}, r"time_step_mean_s: got 0\.5; .*0\.6 to 1\.25 s.* time_step=fixed"),
        ({"station_pose": ["a"] * 16}, "station_pose: .*16 finite numbers"),
        ({"meta": {"mass_fraction": 1.0}}, r"meta\.mass_fraction: .*fraction < 1"),
        ({"meta": {"mass_fraction": 0.3}}, r"meta: got mass_fraction; allowed: nothing where .* dynamics=meta"),
        ({"sun": "bright"}, "fixed"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        gym.make("SpaceDock-v0", **options)


@pytest.mark.parametrize(
    ("options", "step_s"),
    [
        ({"time_step": "fixed", "time_step_mean_s": 2.0}, (2.0, 2.0)),
        ({"time_step_mean_s": 2.0, "time_step_min_s": 1.9, "time_step_max_s": 2.1}, (1.9, 2.1)),
    ],
)
def test_steps_may_be_of_another_length(options, step_s):
    env = make(**options)
    env.reset(seed=0)
    for _ in range(20):
        *_, info = env.step(np.zeros(6))
        assert step_s[0] <= info["dt_s"] <= step_s[1]


def test_a_range_may_be_a_list():
    env = gym.make("SpaceDockMeta-v0", obs_type="agent_pos", meta={"thrust_scale": [0.9, 1.0]})
    assert env.unwrapped.config.meta.thrust_scale == (0.9, 1.0)


numbers = st.floats(width=64) | st.integers(-10, 10)


@settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(numbers, max_size=16), st.lists(numbers, max_size=8))
def test_any_start_or_grid_is_flown_or_refused_clearly(state, steps):
    for check in (lambda: check_start(state, default_mass_kg=1000.0), lambda: check_time_steps(steps)):
        try:
            value = check()
        except InputError as error:
            assert "allowed:" in str(error)  # noqa: PT017
        else:
            assert np.isfinite(value).all()


def test_any_numeric_action_flies_or_is_refused_clearly():
    env = make(max_steps=5000)
    env.reset(seed=0)

    @settings(max_examples=2000, deadline=None)
    @given(st.lists(numbers, min_size=6, max_size=6))
    def check(action):
        if env.unwrapped._running is False:
            env.reset(seed=0)
        try:
            observation, reward, *_ = env.step(action)
        except SpaceDockError as error:
            assert str(error)  # noqa: PT017
        else:
            assert np.isfinite(observation["agent_pos"]).all()
            assert np.isfinite(reward)

    check()
