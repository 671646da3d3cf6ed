"""The vector envs under LeRobot's own rollout rules: each episode recorded once, its end carried out, nothing added."""

import json

import gymnasium as gym
import numpy as np
import pytest
from lerobot.envs.utils import NEW_ROLLOUT_OPTION, freeze_after_episode_end

from lerobot_spacedock.adapters.evaluation_log import METRICS_FILE, EvaluationLog, evaluation_folder
from lerobot_spacedock.adapters.vector_env import LoggingAsyncVectorEnv, LoggingSyncVectorEnv
from lerobot_spacedock.episode_log import log_path
from lerobot_spacedock.errors import InputError


class Countdown(gym.Env):
    """Ends after ``2 + seed % 3`` steps with reward 1 a step; leaves a file per finished episode, as the real env."""

    observation_space = gym.spaces.Dict({"agent_pos": gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)})
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
    metadata = {"render_fps": 1}  # noqa: RUF012 - gymnasium's own convention

    def __init__(self, folder):
        self._folder = folder

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._seed, self._steps = seed, 0
        return self._observe(), {"is_success": False}

    def step(self, action):
        self._steps += 1
        ended = self._steps == 2 + self._seed % 3
        info = {"is_success": ended and self._seed % 2 == 0}
        if ended:
            info |= {"miss_m": 0.5 * self._seed, "outcome": "contact", "nothing": float("nan"), "array": np.ones(3)}
            log_path(self._folder, self._seed).write_text("whole")
        return self._observe(), 1.0, ended, False, info

    def _observe(self):
        return {"agent_pos": np.array([self._seed or 0, self._steps], dtype=np.float32)}


def make(cls, folder, num_envs, num_episodes=None):
    def one():
        return Countdown(folder)

    log = EvaluationLog(folder, num_envs, num_episodes)
    return cls([freeze_after_episode_end(one) for _ in range(num_envs)], log=log)


def roll_out(env, seeds):
    """The loop of ``lerobot_eval.rollout``: step until every env has ended once."""
    env.reset(seed=seeds, options={NEW_ROLLOUT_OPTION: True})
    done, total = np.zeros(env.num_envs, dtype=bool), np.zeros(env.num_envs)
    while not done.all():
        _, reward, terminated, truncated, _ = env.step(np.zeros((env.num_envs, 1), dtype=np.float32))
        total += reward
        done |= terminated | truncated
    return total


def lines(folder):
    return [json.loads(line) for line in (folder / METRICS_FILE).read_text().splitlines()]


@pytest.mark.parametrize("cls", [LoggingSyncVectorEnv, LoggingAsyncVectorEnv])
def test_each_episode_is_recorded_once_with_what_its_end_carried(cls, tmp_path):
    env = make(cls, tmp_path, num_envs=3)
    totals = [roll_out(env, [6, 7, 8]), roll_out(env, [9, 10, 11])]
    env.close()
    env.close()
    found = lines(tmp_path)
    assert sorted(line["seed"] for line in found) == [6, 7, 8, 9, 10, 11]
    assert {line["seed"]: line["episode"] for line in found} == dict(zip(range(6, 12), range(6), strict=True))
    for line in found:
        length = 2 + line["seed"] % 3
        assert line["steps"] == length
        assert line["return"] == length
        assert line["is_success"] == (line["seed"] % 2 == 0)
        assert line["miss_m"] == 0.5 * line["seed"]
        assert line["outcome"] == "contact"
        assert "nothing" not in line  # NaN is not JSON
        assert "array" not in line
    # No reward leaks from a finished episode into the batch's sums.
    np.testing.assert_array_equal(np.concatenate(totals), [2 + seed % 3 for seed in range(6, 12)])


def test_a_batch_of_one(tmp_path):
    env = make(LoggingSyncVectorEnv, tmp_path, num_envs=1)
    assert roll_out(env, [4]) == [3]
    assert [line["seed"] for line in lines(tmp_path)] == [4]


def test_surplus_episodes_of_the_last_batch_are_put_aside(tmp_path):
    env = make(LoggingSyncVectorEnv, tmp_path, num_envs=3, num_episodes=4)
    roll_out(env, [0, 1, 2])
    roll_out(env, [3, 4, 5])
    kept = sorted(path.name for path in tmp_path.glob("episode_*"))
    assert kept == [log_path(tmp_path, seed).name for seed in range(4)]
    assert sorted(path.name for path in tmp_path.glob("surplus/episode_*")) == [
        log_path(tmp_path, seed).name for seed in (4, 5)
    ]
    assert {line["seed"]: line["surplus"] for line in lines(tmp_path)} == {seed: seed >= 4 for seed in range(6)}


def test_the_state_is_there_under_its_dataset_name_too(tmp_path):
    env = make(LoggingSyncVectorEnv, tmp_path, num_envs=2)
    observation, _ = env.reset(seed=[1, 2])
    np.testing.assert_array_equal(observation["observation.state"], observation["agent_pos"])


def test_a_folder_with_the_episodes_of_another_evaluation_is_refused(tmp_path):
    assert evaluation_folder(tmp_path, numbered=False) == tmp_path
    (tmp_path / "episode_001000.parquet").touch()
    with pytest.raises(InputError, match=r"--env\.log_dir.*Give another"):
        evaluation_folder(tmp_path, numbered=False)


def test_evaluations_inside_training_never_share_a_folder(tmp_path):
    assert evaluation_folder(tmp_path, numbered=True).name == "evaluation_0001"
    (tmp_path / "evaluation_0001").mkdir()
    (tmp_path / "evaluation_0007").mkdir()
    assert evaluation_folder(tmp_path, numbered=True).name == "evaluation_0008"
