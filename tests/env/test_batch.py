"""The batched simulator: one row alone, a thousand together, any thread count — the same to the bit."""

import gymnasium as gym
import numpy as np
import pytest

from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.registration import ENV_IDS

META = TaskConfig(contact=True, hill_coupling=True, dynamics="meta", max_steps=30)


def commands(rows, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (rows, 6)) * [30, 30, 30, 2, 2, 2]


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_single_environment_and_batch_agree_to_the_bit(env_id):
    options = {k: v for k, v in ENV_IDS[env_id].items() if k != "withhold_pose"}
    batch = BatchedSpaceDock(64, TaskConfig(initial_conditions="random", **options))
    batch.reset(np.arange(64))
    env = gym.make(
        env_id, obs_type="agent_pos", initial_conditions="random", disable_env_checker=True, **{"withhold_pose": False}
    )
    observation, _ = env.reset(seed=17)
    action = commands(64).astype(np.float32)
    for _ in range(25):
        assert np.array_equal(batch.observe()[17], observation["agent_pos"])
        result = batch.step(action)
        observation, reward, terminated, truncated, info = env.step(action[17])
        assert reward == result.reward[17]
        assert (terminated, truncated) == (result.terminated[17], result.truncated[17])
        assert info["time_s"] == batch.sim.time[17]
        if terminated or truncated:
            break


def test_threads_and_order_change_nothing():
    batches = [BatchedSpaceDock(33, META, threads=t, auto_reset=True) for t in (1, 2)]
    order = np.random.default_rng(1).permutation(33)
    shuffled = BatchedSpaceDock(33, META, auto_reset=True)
    seeds = np.arange(100, 133)
    for batch in batches:
        batch.reset(seeds)
    shuffled.reset(seeds[order])
    action = commands(33)
    for _ in range(70):  # over several automatic resets
        one, two = (batch.step(action) for batch in batches)
        other = shuffled.step(action[order])
        assert np.array_equal(one.observation, two.observation)
        assert np.array_equal(one.observation[order], other.observation)
        assert np.array_equal(one.reward[order], other.reward)


def test_automatic_reset_starts_a_new_episode_and_keeps_the_end():
    batch = BatchedSpaceDock(8, TaskConfig(max_steps=5), auto_reset=True)
    start = batch.reset(np.arange(8)).copy()
    for k in range(1, 6):
        result = batch.step(np.zeros((8, 6)))
        assert result.truncated.all() == (k == 5)
    assert list(result.ended) == list(range(8))
    assert np.allclose(result.final_state[:, :3], start[:, :3], atol=0.01)  # free drift over 5 s from rest
    assert (batch.sim.step == 0).all()
    assert not np.allclose(batch.sim.state[:, :3], start[:, :3])


def test_ended_rows_stay_as_they_are_without_automatic_reset():
    batch = BatchedSpaceDock(3, TaskConfig(max_steps=2))
    batch.reset([1, 2, 3])
    for _ in range(2):
        batch.step(np.zeros((3, 6)))
    frozen = batch.sim.state.copy()
    result = batch.step(np.full((3, 6), 10.0))
    assert np.array_equal(batch.sim.state, frozen)
    assert (result.reward == 0.0).all()
    assert result.ended.size == 0


def test_arrays_are_shared_with_torch():
    torch = pytest.importorskip("torch")
    batch = BatchedSpaceDock(4)
    shared = torch.from_numpy(batch.sim.state)
    batch.reset([0, 1, 2, 3])
    batch.step(commands(4))
    assert shared.data_ptr() == batch.sim.state.ctypes.data
    assert np.array_equal(shared.numpy(), batch.sim.state)
