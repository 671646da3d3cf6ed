"""Shards as tasks of a pipeline: whole or not there, skipped when finished, written again when their worker died."""

import contextlib
import json
import os
import signal
import threading
import time

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lerobot_spacedock.dataset.convert import ConvertConfig, _plan, convert
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.job import Job
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.scale import ExecutorConfig, Submitted, unfinished
from lerobot_spacedock.dataset.shards import write_shard
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.files import write_json


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


def test_killed_when_the_dataset_has_its_name_it_leaves_nothing_behind(log_folder, tmp_path, monkeypatch):
    wanted, job = config(log_folder, tmp_path / "d", num_workers=1), Job(tmp_path / "d")

    def killed(*_) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Job, "_discard", killed)
    with pytest.raises(KeyboardInterrupt):
        convert(wanted)
    monkeypatch.undo()
    assert job.folder.exists()
    assert check_dataset(job.root).errors == []
    with pytest.raises(InputError, match="does not exist"):
        convert(wanted)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d"]


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


class Killer(threading.Thread):
    """Sends SIGKILL to the first process below this one whose command line holds ``sign``."""

    def __init__(self, sign: str, timeout_s: float = 300.0) -> None:
        super().__init__(daemon=True)
        self.sign, self.end, self.killed = sign, time.monotonic() + timeout_s, None

    def run(self) -> None:
        while self.killed is None and time.monotonic() < self.end:
            for process in psutil.Process().children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess, psutil.AccessDenied):
                    if self.sign in " ".join(process.cmdline()):
                        os.kill(process.pid, signal.SIGKILL)
                        self.killed = process.pid
                        return
            time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize("sign", ["ray::RankWorker.run_for_rank", "lerobot_spacedock.dataset.shards"])
def test_ray_goes_on_when_a_worker_is_killed(log_folder, tmp_path, sign):
    """One of two Ray workers dies while it holds a task; then the process that writes a shard for it."""
    pytest.importorskip("ray")
    pytest.importorskip("datatrove")
    killer = Killer(sign)
    killer.start()
    convert(config(log_folder, tmp_path / "d", num_episodes=3, executor=ExecutorConfig("ray", mem_per_cpu_gb=1)))
    assert killer.killed
    assert check_dataset(tmp_path / "d").errors == []
    assert len(DatasetReader(tmp_path / "d").lengths) == 3


@pytest.mark.slow
def test_the_local_pipeline_goes_on_when_a_worker_is_killed(log_folder, tmp_path, capsys):
    pytest.importorskip("datatrove")
    killer = Killer("spawn_main")
    killer.start()
    convert(config(log_folder, tmp_path / "d", executor=ExecutorConfig("local")))
    assert killer.killed
    assert "attempt 2" in capsys.readouterr().out
    assert check_dataset(tmp_path / "d").errors == []


@pytest.mark.slow
def test_a_killed_process_leaves_a_job_that_goes_on(log_folder, tmp_path):
    killer = Killer("spawn_main")
    killer.start()
    with pytest.raises(SpaceDockError, match="same command again"):
        convert(config(log_folder, tmp_path / "d"))
    assert not (tmp_path / "d").exists()
    convert(config(log_folder, tmp_path / "d", num_workers=1))
    assert check_dataset(tmp_path / "d").errors == []


SBATCH = r"""#!/bin/bash
# Runs a job array one task after the other, as a cluster of one slow node would, in a bare environment.
for script; do :; done
for flag; do case $flag in --export=ALL,*) offset=${flag#*RUN_OFFSET=};; esac; done
last=$(sed -n 's/^#SBATCH --array=0-\([0-9]*\).*/\1/p' "$script")
cp "$script" "$FAKE/script_$(ls "$FAKE" | wc -l)"
for task in $(seq 0 "$last"); do
  env -i HOME="$HOME" PATH="$FAKE:/usr/bin:/bin" SLURM_ARRAY_TASK_ID="$task" SLURM_NODELIST=node1 SLURM_JOB_ID=42 \
    RUN_OFFSET="$offset" bash "$script" >> "$FAKE/output" 2>&1
done
echo "Submitted batch job 42"
"""
SRUN = '#!/bin/bash\nwhile [[ $1 == -* ]]; do [[ $1 == -n ]] && shift; shift; done\nexec "$@"\n'


@pytest.mark.slow
def test_what_is_given_to_slurm_runs(log_folder, tmp_path, monkeypatch, capsys):
    """A stand-in for sbatch runs datatrove's script as it is: every shard is written, then the same command ends."""
    pytest.importorskip("datatrove")
    fake = tmp_path / "bin"
    fake.mkdir()
    stand_ins = {"sbatch": SBATCH, "srun": SRUN, "scontrol": "#!/bin/bash\necho node1\n", "squeue": "#!/bin/bash\n"}
    for name, text in stand_ins.items():
        (fake / name).write_text(text)
        (fake / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{fake}:{os.environ['PATH']}")
    monkeypatch.setenv("FAKE", str(fake))
    wanted = config(log_folder, tmp_path / "d", num_episodes=2, executor=ExecutorConfig("slurm", partition="cpu"))
    with pytest.raises(Submitted, match="2 tasks are with Slurm"):
        convert(wanted)
    assert unfinished(Job(tmp_path / "d")) == [], (fake / "output").read_text()[-3000:]
    script = next(fake.glob("script_*")).read_text()
    assert "#SBATCH --partition=cpu" in script
    assert "qos" not in script
    (fake / "squeue").write_text("#!/bin/bash\necho 42 cpu spacedock\n")
    convert(wanted)
    assert check_dataset(tmp_path / "d").errors == []


def test_slurm_is_not_given_the_same_work_twice(log_folder, tmp_path, monkeypatch):
    pytest.importorskip("datatrove")
    for name, text in {"sbatch": "exit 1", "squeue": "echo 42 cpu spacedock"}.items():
        (tmp_path / name).write_text(f"#!/bin/bash\n{text}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    wanted = config(log_folder, tmp_path / "d", executor=ExecutorConfig("slurm", partition="cpu"))
    with pytest.raises(SpaceDockError, match="sbatch refused"):
        convert(wanted)
    write_json(Job(tmp_path / "d").folder / "slurm.json", {"job_id": "42"})
    with pytest.raises(Submitted, match="42 has not ended"):
        convert(wanted)


def test_many_shards_are_merged_a_few_at_a_time(log_folder, tmp_path, monkeypatch):
    monkeypatch.setattr("lerobot_spacedock.dataset.merge.MERGE_AT_ONCE", 2)
    convert(config(log_folder, tmp_path / "parts", num_workers=1, executor=ExecutorConfig()))
    monkeypatch.undo()
    convert(config(log_folder, tmp_path / "once", num_workers=1))
    np.testing.assert_array_equal(states_of(tmp_path / "parts"), states_of(tmp_path / "once"))
    assert check_dataset(tmp_path / "parts").errors == []
    parts, once = (json.loads((tmp_path / name / "meta" / "stats.json").read_text()) for name in ("parts", "once"))
    for key, values in once["action"].items():
        np.testing.assert_allclose(parts["action"][key], values, rtol=1e-9, atol=1e-9)


def test_episodes_of_many_metadata_files_are_all_merged(log_folder, tmp_path, monkeypatch):
    """LeRobot's own append writes the wrong file's number into the rows of a new one, and its next merge loses them."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    monkeypatch.setattr("lerobot_spacedock.dataset.merge.MERGE_AT_ONCE", 2)
    monkeypatch.setattr("lerobot_spacedock.dataset.merge.EPISODES_A_FILE", 3)
    convert(config(log_folder, tmp_path / "many", num_workers=1))
    monkeypatch.undo()
    convert(config(log_folder, tmp_path / "one", num_workers=1))
    files = {name: sorted((tmp_path / name / "meta" / "episodes").rglob("*.parquet")) for name in ("many", "one")}
    assert len(files["one"]) == 1 < len(files["many"])
    many, one = (pa.concat_tables(pq.read_table(path) for path in files[name]).to_pylist() for name in ("many", "one"))
    assert [row.pop("meta/episodes/file_index") for row in many] == sorted(
        number for number, path in enumerate(files["many"]) for _ in range(pq.read_metadata(path).num_rows)
    )
    assert [row["length"] for row in many] == [row["length"] for row in one]
    assert [row["dataset_to_index"] for row in many] == [row["dataset_to_index"] for row in one]
    dataset = LeRobotDataset("test/many", root=tmp_path / "many")
    assert (dataset.num_episodes, dataset.num_frames) == (len(one), one[-1]["dataset_to_index"])
    assert check_dataset(tmp_path / "many").errors == []


def test_executors_say_what_they_need():
    with pytest.raises(InputError, match=r"--executor\.kind"):
        ExecutorConfig("cloud")
    with pytest.raises(InputError, match=r"--executor\.partition"):
        ExecutorConfig("slurm")
    with pytest.raises(InputError, match=r"--executor\.time"):
        ExecutorConfig("ray", time="two hours")
    for name in ("cpus_per_task", "mem_per_cpu_gb", "retries"):
        with pytest.raises(InputError, match=rf"--executor\.{name}: got -1"):
            ExecutorConfig("ray", **{name: -1})
