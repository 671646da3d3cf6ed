"""Shards as tasks of a pipeline: whole or not there, skipped when finished, written again when their worker died."""

import os
import signal
import threading
import time

import numpy as np
import psutil
import pytest

from lerobot_spacedock.dataset.convert import ConvertConfig, _plan, convert
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.job import Job
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.scale import ExecutorConfig, unfinished
from lerobot_spacedock.dataset.shards import write_shard
from lerobot_spacedock.errors import InputError, SpaceDockError


def config(log_folder, root, **options) -> ConvertConfig:
    base = {"source": str(log_folder), "repo_id": "test/scale", "root": str(root), "images": "none", "num_workers": 2}
    return ConvertConfig(**(base | options))


def states_of(root) -> np.ndarray:
    return np.concatenate([episode.rows["true_state"] for episode in DatasetReader(root).iterate()])


def test_a_finished_shard_is_not_written_again(log_folder, tmp_path):
    wanted = config(log_folder, tmp_path / "d")
    job = Job(tmp_path / "d")
    job.begin(wanted.settings())
    job.write_plan(*_plan(wanted))
    assert unfinished(job) == [0, 1, 2, 3, 4]
    write_shard(job.root, 2)
    assert unfinished(job) == [0, 1, 3, 4]
    before = {p: p.stat().st_mtime_ns for p in job.shard(2).rglob("*")}
    write_shard(job.root, 2)
    assert {p: p.stat().st_mtime_ns for p in job.shard(2).rglob("*")} == before


def test_each_worker_reads_its_own_episodes_only(log_folder, tmp_path):
    wanted = config(log_folder, tmp_path / "d")
    job = Job(tmp_path / "d")
    job.begin(wanted.settings())
    plan, refs = _plan(wanted)
    job.write_plan(plan, refs)
    assert [ref for index in range(plan.num_shards) for ref in job.shard_refs(index)] == refs


@pytest.mark.slow
def test_datatrove_gives_what_this_process_gives(log_folder, tmp_path):
    pytest.importorskip("datatrove")
    convert(config(log_folder, tmp_path / "here", num_workers=1))
    convert(config(log_folder, tmp_path / "there", executor=ExecutorConfig("local")))
    np.testing.assert_array_equal(states_of(tmp_path / "here"), states_of(tmp_path / "there"))
    assert check_dataset(tmp_path / "there").errors == []


@pytest.mark.slow
def test_ray_goes_on_when_a_worker_is_killed(log_folder, tmp_path):
    ray = pytest.importorskip("ray")
    pytest.importorskip("datatrove")
    killed = []

    def kill_one() -> None:
        end = time.monotonic() + 300.0
        while not killed and time.monotonic() < end:
            for process in psutil.Process().children(recursive=True):
                if any("ray::" in part for part in process.cmdline()[:1]) and "IDLE" not in process.cmdline()[0]:
                    os.kill(process.pid, signal.SIGKILL)
                    killed.append(process.pid)
                    return
            time.sleep(0.05)

    threading.Thread(target=kill_one, daemon=True).start()
    try:
        convert(config(log_folder, tmp_path / "d", executor=ExecutorConfig("ray", retries=3)))
    finally:
        ray.shutdown()
    assert killed
    assert check_dataset(tmp_path / "d").errors == []
    assert len(DatasetReader(tmp_path / "d").episodes) == 5


@pytest.mark.slow
def test_a_killed_process_leaves_a_job_that_goes_on(log_folder, tmp_path):
    def kill_one() -> None:
        end = time.monotonic() + 200.0
        while time.monotonic() < end:
            spawned = [p for p in psutil.Process().children() if "spawn_main" in " ".join(p.cmdline())]
            if spawned:
                os.kill(spawned[0].pid, signal.SIGKILL)
                return
            time.sleep(0.05)

    threading.Thread(target=kill_one, daemon=True).start()
    with pytest.raises(SpaceDockError, match="same command again"):
        convert(config(log_folder, tmp_path / "d"))
    assert not (tmp_path / "d").exists()
    convert(config(log_folder, tmp_path / "d", num_workers=1))
    assert check_dataset(tmp_path / "d").errors == []


def test_executors_say_what_they_need():
    with pytest.raises(InputError, match=r"--executor\.kind"):
        ExecutorConfig("cloud")
    with pytest.raises(InputError, match=r"--executor\.partition"):
        ExecutorConfig("slurm")
