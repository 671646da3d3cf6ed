"""The vector envs under LeRobot's own rollout rules: each episode recorded once, its end carried out, nothing added."""

import json
import os
import signal
import time
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from lerobot.envs.utils import NEW_ROLLOUT_OPTION, freeze_after_episode_end

from lerobot_spacedock.adapters.evaluation_log import METRICS_FILE, POLICY_FILE, EvaluationLog, evaluation_folder
from lerobot_spacedock.adapters.vector_env import LoggingAsyncVectorEnv, LoggingSyncVectorEnv
from lerobot_spacedock.env.spacedock import SpaceDockEnv
from lerobot_spacedock.episode_log import log_path, read_episode_log
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.metrics.episode import inference


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


def test_a_killed_process_is_said_and_what_was_finished_is_kept(tmp_path):
    """gymnasium alone would wait for ever for its answer, when the vector env is closed or the program ends."""
    env = make(LoggingAsyncVectorEnv, tmp_path, num_envs=2)
    env.reset(seed=[6, 7], options={NEW_ROLLOUT_OPTION: True})
    action = np.zeros((2, 1), dtype=np.float32)
    env.step(action)
    env.step(action)  # the first episode ends
    os.kill(env.processes[1].pid, signal.SIGKILL)
    with pytest.raises(SpaceDockError, match=r"environment \[1\] was ended from outside.*kept in"):
        env.step(action)
    env.close()
    assert not any(process.is_alive() for process in env.processes)
    assert [line["seed"] for line in lines(tmp_path)] == [6]
    assert log_path(tmp_path, 6).exists()


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


@pytest.mark.parametrize("cls", [LoggingSyncVectorEnv, LoggingAsyncVectorEnv])
def test_the_policys_time_is_in_the_logs_and_the_envs_own_is_not(cls, tmp_path):
    """Thinks 20 ms a step, 200 ms at the very first; pictures take 200 ms, drawn before it asks for the task."""
    env = cls([freeze_after_episode_end(partial(SlowToDraw, tmp_path))] * 2, log=EvaluationLog(tmp_path, 2, None))
    thought = np.zeros((2, 4))
    for batch, seeds in enumerate(([5, 6], [7, 8])):
        env.reset(seed=seeds, options={NEW_ROLLOUT_OPTION: True})
        for k in range(4):
            env.call("render")
            env.call("task_description")
            began = time.perf_counter()
            time.sleep(0.2 if batch == k == 0 else 0.02)
            thought[batch, k] = time.perf_counter() - began
            env.step(np.zeros((2, 6), dtype=np.float32))
    env.close()
    for seed in range(5, 9):
        log = read_episode_log(log_path(tmp_path, seed))
        warm_up = int(seed < 7)
        assert log.metadata["inference"] == {"batch": 2, "warm_up_steps": warm_up}
        beyond = log.extra["inference_s"] - thought[0 if seed < 7 else 1]
        assert (beyond >= 0.0).all()
        assert np.median(beyond) < 0.1  # a busy machine may be late once, not mostly
        counted = log.extra["inference_s"][warm_up:]
        assert inference(log)["inference_ms"] == pytest.approx(1e3 * counted.mean())
        assert inference(log)["inference_max_ms"] == pytest.approx(1e3 * counted.max())
        (line,) = (line for line in lines(tmp_path) if line["seed"] == seed)
        assert (line["inference_batch"], line["inference_ms"]) == (2, pytest.approx(1e3 * counted.mean()))


class SlowToDraw(SpaceDockEnv):
    """The real environment, four steps long, whose pictures take 200 ms."""

    def __init__(self, folder):
        super().__init__(render_mode="rgb_array", obs_type="agent_pos", max_steps=4, log_dir=str(folder))

    def _draw(self):
        time.sleep(0.2)
        return np.zeros((8, 8, 3), dtype=np.uint8)


def test_what_flies_is_written_once_and_the_end_is_told_once(tmp_path):
    asked, ended = [], []
    log = EvaluationLog(
        tmp_path, 1, None, policy=lambda: asked.append(1) or {"type": "act"}, at_end=lambda folder: ended.append(folder)
    )
    env = LoggingSyncVectorEnv([freeze_after_episode_end(partial(Countdown, tmp_path))], log=log)
    roll_out(env, [1])
    assert json.loads((tmp_path / POLICY_FILE).read_text()) == {"type": "act"}
    roll_out(env, [2])
    env.close()
    env.close()
    assert (asked, ended) == ([1], [tmp_path])
