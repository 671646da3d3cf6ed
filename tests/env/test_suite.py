"""Invariants of every registered id (after dm_control's suite test)."""

import copy
import pickle
import re

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import lerobot_spacedock  # noqa: F401  registers the ids
from lerobot_spacedock.env import ENV_IDS
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.spacedock import SpaceDockEnv, observation_names
from lerobot_spacedock.physics.frames import ACTION_NAMES

SMALL = {"camera": {"height": 24, "width": 32}}
ids = pytest.mark.parametrize("env_id", ENV_IDS)


def make(env_id, **options):
    return gym.make(env_id, disable_env_checker=True, **({"obs_type": "agent_pos"} | options))


def fly(env, seed, steps=20):
    """Observations, rewards and infos of a short flight under commands drawn from the seed."""
    rng = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    trace = [(observation, 0.0, False, info)]
    for _ in range(steps):
        action = (rng.uniform(-1, 1, 6) * [10, 10, 10, 0.5, 0.5, 0.5]).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        trace.append((observation, reward, terminated or truncated, info))
        if terminated or truncated:
            break
    return trace


@ids
@pytest.mark.render
@pytest.mark.filterwarnings("ignore:.*infinity.*", "ignore:.*symmetric and normalized.*")
def test_passes_gymnasiums_checker(env_id):
    env = gym.make(env_id, render_mode="rgb_array", **SMALL)
    check_env(env.unwrapped)


@ids
@pytest.mark.parametrize("obs_type", ["agent_pos", pytest.param("pixels_agent_pos", marks=pytest.mark.render)])
@pytest.mark.filterwarnings("ignore")
def test_passes_stable_baselines3s_checker(env_id, obs_type):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = make(env_id, obs_type=obs_type, camera={"height": 40, "width": 48})
    if obs_type != "agent_pos":
        # stable-baselines3 does not take a Dict in a Dict, which is how LeRobot wants its pixels
        env = gym.wrappers.FlattenObservation(env)
    checker.check_env(env)


@ids
def test_same_seed_same_states_to_the_bit_and_other_seeds_differ(env_id):
    first, again = make(env_id), make(env_id)
    fly(again, 99)  # what was flown before leaves no trace
    one, two, other = fly(first, 4), fly(again, 4), fly(first, 5)
    for (a, ra, _, ia), (b, rb, _, ib) in zip(one, two, strict=True):
        assert np.array_equal(a["agent_pos"], b["agent_pos"])
        assert ra == rb
        assert np.array_equal(ia["state"], ib["state"])
    assert not np.array_equal(one[0][3]["state"][:3], other[0][3]["state"][:3])
    assert one[5][3]["time_s"] != other[5][3]["time_s"]


@ids
def test_successive_episodes_differ_and_share_no_memory(env_id):
    env = make(env_id)
    first, info = env.reset(seed=0)
    kept = copy.deepcopy(first)
    env.step(np.full(6, 5.0, dtype=np.float32))
    _, later = env.reset()
    assert np.array_equal(first["agent_pos"], kept["agent_pos"])
    assert not np.array_equal(info["state"], later["state"])


@ids
@pytest.mark.render
def test_pictures_share_no_memory_and_render_is_the_observation(env_id):
    env = make(env_id, obs_type="pixels_agent_pos", render_mode="rgb_array", **SMALL)
    first, _ = env.reset(seed=0)
    kept = first["pixels"]["camera"].copy()
    second, *_ = env.step(np.full(6, 20.0, dtype=np.float32))
    assert np.array_equal(first["pixels"]["camera"], kept)
    assert np.array_equal(env.render(), second["pixels"]["camera"])
    assert kept.shape == (24, 32, 3)
    assert kept.dtype == np.uint8
    assert kept.std() > 5.0  # a scene, not a blank
    env.close()
    env.close()


@ids
def test_no_global_random_state_is_read_or_written(env_id):
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    one = fly(make(env_id), 3)
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002
    np.random.seed(2)  # noqa: NPY002
    two = fly(make(env_id), 3)
    assert all(np.array_equal(a[0]["agent_pos"], b[0]["agent_pos"]) for a, b in zip(one, two, strict=True))


@ids
@pytest.mark.parametrize("with_mass", [False, True])
def test_spaces_are_what_is_returned(env_id, with_mass):
    env = make(env_id, with_mass=with_mass)
    space = env.observation_space["agent_pos"]
    assert space.shape == (len(observation_names(env.unwrapped.config)),)
    for observation, *_ in fly(env, 7, steps=200):
        assert observation["agent_pos"].dtype == space.dtype == np.float32
        assert env.observation_space.contains(observation)


@ids
@pytest.mark.parametrize("asynchronous", [False, True])
def test_vectorised_by_gymnasium_in_both_modes(env_id, asynchronous):
    if asynchronous and env_id != "SpaceDockMeta-v0":
        pytest.skip("one id is enough for the process-based mode")
    cls = gym.vector.AsyncVectorEnv if asynchronous else gym.vector.SyncVectorEnv
    envs = cls([lambda: make(env_id) for _ in range(2)], **({"context": "forkserver"} if asynchronous else {}))
    observation, _ = envs.reset(seed=[4, 9])
    singles = [make(env_id), make(env_id)]
    alone = [env.reset(seed=seed)[0] for env, seed in zip(singles, (4, 9), strict=True)]
    action = np.tile(np.float32([3, -2, 8, 0.1, 0.2, -0.1]), (2, 1))
    for _ in range(5):
        assert np.array_equal(observation["agent_pos"], np.stack([a["agent_pos"] for a in alone]))
        observation, *_ = envs.step(action)
        alone = [env.step(a)[0] for env, a in zip(singles, action, strict=True)]
    envs.close()


@ids
def test_config_survives_pickling(env_id):
    config = SpaceDockConfig.from_options(env_id=env_id, **ENV_IDS[env_id])
    assert pickle.loads(pickle.dumps(config)) == config


@ids
def test_success_is_told_on_every_step_and_outcome_at_the_end(env_id):
    env = make(env_id)
    trace = fly(env, 1, steps=200)
    assert all(isinstance(info["is_success"], bool) for *_, info in trace)
    assert all(info["outcome"] == "running" for *_, info in trace[:-1])
    assert trace[-1][2]
    assert trace[-1][3]["outcome"] != "running"
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(6, dtype=np.float32))


def test_docstring_table_is_the_spaces():
    """The class docstring is the one table of the observation; it must say what the spaces say."""
    rows = re.findall(r"\| `(agent_pos|pixels)`(.*?) \| \((.*?)\) \| (\w+) \| (.*?) \|", SpaceDockEnv.__doc__)
    assert len(rows) == 4
    for key, variant, shape, dtype, values in rows:
        options = {name: True for name in ("with_mass", "withhold_pose") if name in variant}
        env = gym.make("SpaceDock-v0", disable_env_checker=True, **options).unwrapped
        space = env.observation_space[key]
        space = space["camera"] if key == "pixels" else space
        assert space.shape == tuple(int(n) for n in shape.rstrip(",").split(","))
        assert space.dtype == np.dtype(dtype)
        if key == "agent_pos" and "with_mass" not in variant:
            named = re.sub(r"\[.*?\]", "", values).replace(" ", "").split(",")
            assert tuple(named) == observation_names(env.config)
    assert env.action_space.shape == (len(ACTION_NAMES),)
    assert np.array_equal(env.action_space.high, np.float32([60, 60, 60, 20, 20, 20]))
