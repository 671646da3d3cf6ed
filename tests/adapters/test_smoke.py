"""The pipeline through the real commands: demonstrations → stock ACT training → stock evaluation → report."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lerobot_spacedock.episode_log import read_episode_log

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"

pytestmark = pytest.mark.render


def run(folder, command, *arguments):
    """Runs an installed command in a folder of its own, as a user would, without a network."""
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    result = subprocess.run(
        [str(Path(sys.executable).parent / command), *map(str, arguments)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-4000:]
    return result


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def seeds_of(folder):
    return sorted(int(path.stem.removeprefix("episode_")) for path in folder.glob("episode_*.parquet"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pipeline")


@pytest.fixture(scope="module")
def dataset(folder):
    camera = ("--camera.height=96", "--camera.width=128", "--camera.samples=1", "--camera.shadows=false")
    run(folder, "spacedock", "demos", "--num_episodes=3", *camera, "--repo_id=spacedock/smoke", "--root=data")
    return folder / "data"


@pytest.fixture(scope="module")
def training(folder, dataset):
    run(
        folder,
        "lerobot-train",
        f"--config_path={CONFIGS / 'act_smoke.yaml'}",
        f"--dataset.root={dataset}",
        "--dataset.repo_id=spacedock/smoke",
        "--output_dir=act",
        *("--steps=8", "--save_freq=8", "--env_eval_freq=4", "--env.max_steps=5", "--env.camera.samples=1"),
    )
    return folder / "act"


@pytest.fixture(scope="module")
def act_evaluation(folder, training):
    run(
        folder,
        "lerobot-eval",
        f"--config_path={CONFIGS / 'eval_paper.yaml'}",
        f"--policy.path={training / 'checkpoints' / 'last' / 'pretrained_model'}",
        *("--policy.n_action_steps=1", "--policy.temporal_ensemble_coeff=0.01"),
        *("--env.camera.height=96", "--env.camera.width=128", "--env.camera.samples=1", "--env.max_steps=12"),
        *("--eval.n_episodes=3", "--eval.batch_size=2", "--eval.use_async_envs=true"),
        *("--output_dir=eval-act", "--env.log_dir=logs/act", "--env.label=ACT"),
    )
    return folder / "eval-act", folder / "logs" / "act"


@pytest.fixture(scope="module")
def mpc_evaluation(folder):
    run(
        folder,
        "lerobot-eval",
        f"--config_path={CONFIGS / 'eval_contact.yaml'}",
        *("--policy.type=spacedock_mpc", "--policy.device=cpu", "--env.obs_type=agent_pos"),
        *("--eval.n_episodes=2", "--eval.batch_size=2", "--eval.recording=true", "--output_dir=eval-mpc"),
    )
    return folder / "eval-mpc"


def test_training_saves_a_checkpoint_that_holds_no_pickle(training):
    checkpoint = training / "checkpoints" / "last" / "pretrained_model"
    assert (checkpoint / "model.safetensors").stat().st_size > 0
    assert {path.suffix for path in checkpoint.iterdir()} == {".json", ".safetensors"}


def test_each_evaluation_inside_training_keeps_its_own_logs(training):
    folders = sorted(path.name for path in (training / "episodes").iterdir())
    assert folders == ["evaluation_0001", "evaluation_0002", "tensorboard"]
    for name in folders[:2]:
        assert seeds_of(training / "episodes" / name) == [1000, 1001]
        assert len(lines(training / "episodes" / name / "eval_metrics.jsonl")) == 2


def test_an_async_evaluation_logs_each_counted_episode_once(act_evaluation):
    output, logs = act_evaluation
    assert seeds_of(logs) == [1000, 1001, 1002]
    assert seeds_of(logs / "surplus") == [1003]
    assert json.loads((output / "eval_info.json").read_text())["overall"]["n_episodes"] == 3
    recorded = {line["seed"]: line["surplus"] for line in lines(logs / "eval_metrics.jsonl")}
    assert recorded == {1000: False, 1001: False, 1002: False, 1003: True}


@pytest.mark.parametrize("which", ["act", "mpc"])
def test_logs_and_lerobot_agree_on_every_episode(which, act_evaluation, mpc_evaluation):
    output, logs = act_evaluation if which == "act" else (mpc_evaluation, mpc_evaluation / "episodes")
    (task,) = json.loads((output / "eval_info.json").read_text())["per_task"]
    found = [read_episode_log(logs / f"episode_{seed:06d}.parquet") for seed in seeds_of(logs)]
    assert [log.metadata["success"] for log in found] == task["metrics"]["successes"]
    # LeRobot sums float64 rewards, all of the episode and nothing after it.
    np.testing.assert_allclose([log.reward.sum() for log in found], task["metrics"]["sum_rewards"], rtol=1e-6)
    for log in found:
        np.testing.assert_allclose(np.diff(log.time), log.dt, rtol=0, atol=1e-12)


def test_the_paper_task_has_its_fixed_horizon_and_the_label_is_kept(act_evaluation):
    log = read_episode_log(act_evaluation[1] / "episode_001000.parquet")
    assert log.num_steps == 12
    assert (log.metadata["label"], log.metadata["outcome"]) == ("ACT", "horizon")
    assert np.isfinite(log.action).all()


def test_the_classical_limit_docks_under_stock_lerobot_eval(mpc_evaluation):
    assert json.loads((mpc_evaluation / "eval_info.json").read_text())["overall"]["pc_success"] == 100.0
    log = read_episode_log(mpc_evaluation / "episodes" / "episode_001000.parquet")
    assert np.linalg.norm(log.state[-1, :3]) < 0.10  # m, IDSS lateral limit, at the port plane
    assert np.linalg.norm(log.state[0, :3]) > 20.0


def test_a_recorded_evaluation_is_a_dataset_of_the_same_flight(mpc_evaluation):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    (root,) = mpc_evaluation.glob("recordings/*/env_0")
    recorded = LeRobotDataset("spacedock/recorded", root=root)
    log = read_episode_log(mpc_evaluation / "episodes" / "episode_001000.parquet")
    states = np.stack([recorded[i]["observation.state"].numpy() for i in range(len(recorded))])
    assert len(recorded) == log.num_steps
    without_mass = np.delete(log.state[:-1], 6, axis=1)
    np.testing.assert_allclose(states, without_mass.astype(np.float32), rtol=1e-6, atol=1e-6)


def test_the_report_counts_every_episode(folder, act_evaluation, mpc_evaluation):
    result = run(
        folder,
        "spacedock",
        "report",
        "--out=report",
        "--runs",
        f"ACT={act_evaluation[1]}",
        f"MPC={mpc_evaluation}/episodes",
    )
    assert result.stdout.startswith("5 episodes counted, 1 excluded")  # the surplus one
    assert list((folder / "report").glob("*.md"))
    assert list((folder / "report").rglob("*.png"))
