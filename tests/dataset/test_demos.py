"""``spacedock demos`` as its user runs it: killed, gone on, disturbed, refused."""

import json
import os
import signal
import subprocess
import sys
import time

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest

from lerobot_spacedock.camera import CameraConfig, SensorConfig
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.demos import DemosConfig, demos, flight_blocks, fly_block
from lerobot_spacedock.dataset.disturbance import KickConfig
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.pictures_check import FrameStore
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.episode_log import iterate_episode_logs, read_episode_log
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.expert.controllers import make_expert


def config(root, **options) -> DemosConfig:
    base = {"repo_id": "test/demos", "root": str(root), "expert": "V", "image": False, "num_workers": 1}
    return DemosConfig(**(base | options))


def data_of(root) -> dict:
    return pq.read_table(root / "data" / "chunk-000" / "file-000.parquet").to_pydict()


def test_the_best_are_kept_and_the_dataset_says_how(tmp_path):
    root = tmp_path / "d"
    options = {"num_episodes": 4, "num_candidates": 9, "initial_conditions": "same,wide", "select": "propellant"}
    assert demos(config(root, kicks=KickConfig(0.2, quiet_m=3.0), log_dir=str(tmp_path / "logs"), **options)) == 0
    report = check_dataset(root)
    assert (report.errors, report.episodes) == ([], 4)
    facts = json.loads((root / "meta" / "spacedock.json").read_text())
    assert facts["disturbance"]["kicks"]["probability"] == 0.2
    assert facts["initial_conditions"] == ["same", "wide"]
    assert facts["selection"]["flown"] == 9
    assert "0.2 a step" in (root / "README.md").read_text()
    logs = [log for _, log in iterate_episode_logs(tmp_path / "logs")]
    assert [log.metadata["seed"] for log in logs] == facts["selection"]["seeds"]
    assert {log.metadata["initial_conditions"] for log in logs} <= {"same", "wide"}
    rows = next(DatasetReader(root).iterate()).rows
    assert (rows[schema.ACTION] != rows[schema.EXECUTED_ACTION]).any()
    assert not (tmp_path / "d.part").exists()


def test_of_the_vision_task_the_expert_sees_the_state_and_the_dataset_what_the_policy_will_see(tmp_path):
    root, options = tmp_path / "d", {"num_episodes": 2, "image": True, "camera": CameraConfig(height=48, width=64)}
    options |= {"kicks": KickConfig(0.1, quiet_m=3.0)}
    assert demos(config(root, env_id="SpaceDockVision-v0", storage=Storage(kind="image"), **options)) == 0
    report = check_dataset(root, sample_frames=4)
    assert (report.errors, report.warnings, report.checks["dynamics"]) == ([], [], 2)
    names = ["vx", "vy", "vz", "w1", "w2", "w3"]
    reader = DatasetReader(root)
    assert reader.features[schema.STATE]["names"] == names
    assert reader.about.column("success").all()
    with gym.make("SpaceDockVision-v0", obs_type="agent_pos") as env:
        seen, _ = env.reset(seed=100_000)
    first = next(reader.iterate())
    np.testing.assert_allclose(first.rows[schema.STATE][0], seen["agent_pos"], atol=1e-6)
    assert "--env.task=SpaceDockVision-v0" in (root / "README.md").read_text()
    log = first.log()
    np.testing.assert_array_equal(log.state[:-1, :3], first.rows[schema.TRUE_STATE][:, :3])


def test_killed_at_any_moment_it_goes_on_and_ends_as_if_it_had_not_been(tmp_path):
    """SIGKILL while it flies and while it writes; every finished flight stays readable, and none is flown twice."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    options = {"num_episodes": 12, "num_candidates": 14, "kicks": KickConfig(0.1, quiet_m=3.0)}
    demos(config(whole, **options))
    command = [
        sys.executable, "-m", "lerobot_spacedock.cli", "demos", "--repo_id=test/demos", f"--root={cut}", "--expert=V",
        "--image=false", "--num_workers=1", "--num_episodes=12", "--num_candidates=14", "--kicks.probability=0.1",
        "--kicks.quiet_m=3.0",
    ]  # fmt: skip
    part = tmp_path / "cut.part"
    for sight in ("flights/episode_100003.parquet", "shards/shard_000001"):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(lambda sight=sight: (part / sight).exists(), process)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert not cut.exists()
        flown = {p: (p.stat().st_mtime_ns, read_episode_log(p).num_steps) for p in part.glob("flights/episode_*")}
        assert all(steps > 10 for _, steps in flown.values())
    assert len(flown) == 14
    written = {p.name: p.stat().st_mtime_ns for p in part.glob("shards/shard_*")}
    assert written
    assert demos(config(cut, **options)) == 0
    assert data_of(cut) == data_of(whole)
    assert check_dataset(cut).errors == []
    assert not part.exists()


def wait_until(seen, process, timeout_s: float = 240.0) -> None:
    end = time.monotonic() + timeout_s
    while not seen():
        assert process.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < end
        time.sleep(0.002)


def test_a_second_process_keeps_out(tmp_path):
    from lerobot_spacedock.dataset.job import Job

    with Job(tmp_path / "d").lock(), pytest.raises(InputError, match="no other process"):
        demos(config(tmp_path / "d", num_episodes=1))


@pytest.mark.parametrize(
    ("options", "flag"),
    [
        ({"expert": "wizard"}, "--expert"),
        ({"checkpoint": "x"}, "--checkpoint"),
        ({"env_id": "SpaceDock-v9"}, "--env_id"),
        ({"initial_conditions": "same,moon"}, "initial_conditions"),
        ({"num_episodes": 0}, "--num_episodes"),
        ({"num_candidates": 3, "num_episodes": 5}, "--num_candidates"),
        ({"select": "luck"}, "--select"),
        ({"seed": -1}, "--seed"),
        ({"num_workers": -1}, "--num_workers"),
        ({"repo_id": "x y/z"}, "--repo_id"),
        ({"sun": "red"}, "sun"),
        ({"kicks": KickConfig(quiet_m=1.0)}, "--kicks.quiet_m"),
        ({"image": True, "camera": CameraConfig(height=47, width=64)}, "image size"),
    ],
)
def test_what_cannot_be_flown_is_said_and_nothing_is_left(tmp_path, options, flag):
    with pytest.raises(InputError, match=flag):
        demos(config(tmp_path / "d", **options))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [{"log_dir": "/proc/logs"}, {"root": "/proc/logs"}])
def test_a_folder_that_may_not_be_written_is_said_before_anything_is_flown(tmp_path, options):
    with pytest.raises(SpaceDockError, match="/proc/logs"):
        demos(config(**({"root": tmp_path / "d"} | options)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("root", [".", "/"])
def test_a_root_without_a_name_is_refused(tmp_path, monkeypatch, root):
    monkeypatch.chdir(tmp_path)
    for run in (
        lambda: demos(config(root, num_episodes=1)),
        lambda: convert(ConvertConfig(str(tmp_path), "a/b", format="npz", root=root, images="none")),
    ):
        with pytest.raises(InputError, match=f"--root: got {root}; allowed: a folder that does not exist"):
            run()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_said_and_costs_nothing(tmp_path):
    """A limit on the size of files stands for the full disk: the system refuses the write in the same place."""
    code = f"""
import resource, sys, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from lerobot_spacedock.dataset.convert import *
import lerobot.datasets.lerobot_dataset
from lerobot_spacedock.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))
sys.exit(main(["demos", "--repo_id=test/demos", "--root={tmp_path}/d", "--expert=V", "--image=false",
    "--num_workers=1", "--num_episodes=2"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 2, done.stderr[-2000:]
    assert "File too large" in done.stderr
    assert not (tmp_path / "d").exists()
    assert demos(config(tmp_path / "d", num_episodes=2)) == 0
    assert np.isfinite(data_of(tmp_path / "d")["sim_time"]).all()


def test_sampled_actions_differ_from_block_to_block(tmp_path, monkeypatch):
    seeds = []

    def watched(*arguments, **keywords):
        seeds.append(keywords["seed"])
        return make_expert(*arguments, **keywords)

    monkeypatch.setattr("lerobot_spacedock.dataset.demos.FLIGHT_BLOCK", 1)
    monkeypatch.setattr("lerobot_spacedock.dataset.demos.make_expert", watched)
    flown = config(
        tmp_path / "d", expert="meta_rl_sampled", num_episodes=1, num_candidates=2, initial_conditions="same"
    )
    logs = [log for block in flight_blocks(flown) for log in fly_block(flown, *block)]
    assert len(set(seeds)) == 2
    policies = [make_expert("meta_rl_sampled", SpaceDockConfig(), seed=seed) for seed in seeds]
    observation = np.zeros((1, 13), dtype=np.float32)
    observation[0, 6] = 1.0
    for policy in policies:
        policy.reset(1)
    assert (policies[0].act(observation) != policies[1].act(observation)).any()
    again = [log for block in flight_blocks(flown) for log in fly_block(flown, *block)]
    for log, other in zip(logs, again, strict=True):
        np.testing.assert_array_equal(log.action, other.action)


def test_noisy_frames_are_those_that_the_environment_shows(tmp_path):
    root, camera = tmp_path / "d", CameraConfig(height=32, width=48, sensor=SensorConfig(read_noise=0.05))
    flown = {"num_episodes": 2, "num_candidates": 2, "image": True, "camera": camera, "select": "first", "seed": 40}
    assert demos(config(root, log_dir=str(tmp_path / "logs"), storage=Storage(kind="image"), **flown)) == 0
    env = gym.make("SpaceDockContact-v0", camera={"height": 32, "width": 48, "sensor": {"read_noise": 0.05}})
    pictures = {}
    for episode, (_, log) in enumerate(iterate_episode_logs(tmp_path / "logs")):
        observation, _ = env.reset(seed=log.metadata["seed"])
        for k in range(4):
            stored = FrameStore(DatasetReader(root), schema.IMAGE).frame(episode, k)
            np.testing.assert_array_equal(stored, observation["pixels"]["camera"])
            pictures[episode, k] = stored.astype(int)
            observation = env.step(log.action[k].astype(np.float32))[0]
    assert np.abs(pictures[0, 0] - pictures[1, 0]).mean() > 1.0  # and each has noise of its own
    report = check_dataset(root, sample_frames=64)
    assert report.errors == []
    assert report.psnr_dB[0] > 45.0, "every frame has its own noise when it is drawn again"
    first = env.reset(seed=40)[0]["pixels"]["camera"]
    np.testing.assert_array_equal(first, env.reset(seed=40)[0]["pixels"]["camera"])


def test_noisy_frames_of_a_segment_are_drawn_again_as_they_are(tmp_path):
    root, camera = tmp_path / "d", CameraConfig(height=32, width=48, sensor=SensorConfig(read_noise=0.05))
    flown = {"num_episodes": 1, "num_candidates": 1, "image": True, "camera": camera, "segment": "last:20s"}
    assert demos(config(root, storage=Storage(kind="image"), **flown)) == 0
    report = check_dataset(root, sample_frames=32)
    assert report.errors == []
    assert report.psnr_dB[0] > 45.0
