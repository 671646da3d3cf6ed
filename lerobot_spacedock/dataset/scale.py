"""Where the shards of a job are written: this machine's processes, or a datatrove pipeline on it, on Ray or on Slurm.

One shard a task; a shard that is finished is skipped, whoever wrote it, so every way goes on from where any other
stopped. The working folder has to be on a file system that all workers see.
"""

from __future__ import annotations

import functools
import json
import re
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lerobot_spacedock.dataset.job import Job, Plan
from lerobot_spacedock.dataset.shards import finished, remove_stale, write_shard
from lerobot_spacedock.dataset.workers import run_processes, run_shards
from lerobot_spacedock.errors import InputError, MissingDependencyError, SpaceDockError
from lerobot_spacedock.files import write_json
from lerobot_spacedock.invocation import available_cores

KINDS = ("processes", "local", "ray", "slurm")
OBJECT_STORE_BYTES = 100 * 1024**2


@dataclass(frozen=True)
class ExecutorConfig:
    """Where shards are written. Flags as in ``--executor.kind=ray``."""

    # processes (no further package needed) | local, ray or slurm (datatrove: pip install '.[scale]')
    kind: str = "processes"
    # ray: address of a running cluster; left out, one is started here
    ray_address: str | None = None
    # slurm: partition to submit to
    partition: str | None = None
    # slurm: quality of service, where the cluster asks for one
    qos: str | None = None
    # ray and slurm: time limit of a task, HH:MM:SS
    time: str = "02:00:00"
    # ray and slurm: cores a task may use
    cpus_per_task: int = 1
    # ray and slurm: GB of memory a core
    mem_per_cpu_gb: int = 4
    # local and ray: how often tasks that failed or were killed are tried again
    retries: int = 2

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("--executor.kind", self.kind, " | ".join(KINDS))
        if self.kind == "slurm" and not self.partition:
            raise InputError("--executor.partition", self.partition, "a partition of the cluster, for slurm")
        for name, least in (("cpus_per_task", 1), ("mem_per_cpu_gb", 1), ("retries", 0)):
            if getattr(self, name) < least:
                raise InputError(f"--executor.{name}", getattr(self, name), f"{least} or more")
        if not re.fullmatch(r"\d+:[0-5]\d:[0-5]\d", self.time):
            raise InputError("--executor.time", self.time, "hours, minutes and seconds: HH:MM:SS")

    @property
    def here(self) -> bool:
        """Whether the work is done on this machine."""
        return self.kind in ("processes", "local")

    @property
    def time_limit_s(self) -> int:
        hours, minutes, seconds = map(int, self.time.split(":"))
        return 3600 * hours + 60 * minutes + seconds


class Submitted(SpaceDockError):
    """The work runs elsewhere; the same command goes on when it is done."""


def run_executor(job: Job, config: ExecutorConfig, *, num_workers: int, total_frames: int | None) -> None:
    """Writes all shards of the job that are not finished.

    Raises:
        SpaceDockError: some could not be written; what is finished stays.
        Submitted: Slurm has taken the work; the dataset is put together by the same command when that is done.
    """
    if config.kind == "processes":
        run_shards(job, num_workers=num_workers, total_frames=total_frames)
        return
    if config.kind == "slurm":
        _submit(job, config, num_workers)
        return
    missing = unfinished(job)
    remove_stale(job)
    try:
        for attempt in range(config.retries + 1):
            if not missing:
                return
            print(f"{len(missing)} shards to write ({config.kind}, attempt {attempt + 1})")
            _run_pipeline(job, missing, config, num_workers or available_cores(), attempt)
            missing = unfinished(job)
    finally:
        if config.kind == "ray":
            _stop_ray()
    if missing:
        raise SpaceDockError(
            f"{len(missing)} shards could not be written; see {job.folder / 'datatrove'}. What is finished stays: run "
            "the same command again, or with --executor.kind=processes to see the error itself."
        )


def unfinished(job: Job) -> list[int]:
    """Indices of the shards that are still to be written."""
    return [index for index in range(Plan.read(job.plan_path).num_shards) if not finished(job, index)]


def _run_pipeline(job: Job, shards: list[int], config: ExecutorConfig, workers: int, attempt: int) -> None:
    log_folder = job.folder / "datatrove" / f"attempt_{attempt}"
    try:
        if config.kind == "local":
            task = functools.partial(run_rank, str(job.root.resolve()), shards, str(log_folder.resolve()))
            run_processes(task, list(range(len(shards))), min(workers, len(shards)))
        else:
            _run_ray(job, shards, config, workers, log_folder)
    except Exception as error:  # a failed or killed task; unfinished() tells which, and retries follow
        print(f"  {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}")


def run_rank(root: str, shards: list[int], log_folder: str, rank: int, *, encoder_threads: int) -> None:
    """One task of the pipeline in this process.

    datatrove's own pool waits for ever for a worker that was killed; so each worker of ours, whose death is noticed,
    runs an executor of one task.
    """
    from datatrove.executor import LocalPipelineExecutor

    LocalPipelineExecutor(
        pipeline=[_step_class()(root, shards, encoder_threads)],
        tasks=len(shards),
        local_tasks=1,
        local_rank_offset=rank,
        workers=1,
        logging_dir=log_folder,
        skip_completed=False,  # a finished shard says so itself
    ).run()


def _run_ray(job: Job, shards: list[int], config: ExecutorConfig, workers: int, log_folder: Path) -> None:
    from datatrove.executor.ray import RayPipelineExecutor

    _start_ray(config, workers)
    RayPipelineExecutor(
        pipeline=[_step_class()(str(job.root.resolve()), shards, config.cpus_per_task, own_process=True)],
        tasks=len(shards),
        workers=workers,
        logging_dir=str(log_folder.resolve()),
        skip_completed=False,
        cpus_per_task=config.cpus_per_task,
        mem_per_cpu_gb=config.mem_per_cpu_gb,
        time=config.time_limit_s,
    ).run()


def _start_ray(config: ExecutorConfig, workers: int) -> None:
    """Joins the cluster, or starts one of this machine that grants exactly what the tasks ask for."""
    try:
        import ray
    except ImportError as error:
        raise MissingDependencyError("ray is needed: pip install '.[scale]' in SpaceDock's folder") from error
    if ray.is_initialized():
        return
    local = {
        "num_cpus": workers * config.cpus_per_task,
        "_memory": workers * config.cpus_per_task * config.mem_per_cpu_gb * 1024**3,
        "object_store_memory": OBJECT_STORE_BYTES,  # tasks hand over names, not data
        "include_dashboard": False,
    }
    try:
        ray.init(address=config.ray_address, log_to_driver=False, **({} if config.ray_address else local))
    except Exception as error:  # Ray raises plain Exception for a node that did not come up
        where = f"reached at {config.ray_address}" if config.ray_address else "started"
        raise SpaceDockError(f"Ray could not be {where}: {error}") from error


def _stop_ray() -> None:
    ray = sys.modules.get("ray")
    if ray is not None and ray.is_initialized():
        ray.shutdown()


def _submit(job: Job, config: ExecutorConfig, num_workers: int) -> None:
    """Gives the unfinished shards to Slurm, unless it has them already.

    Raises:
        Submitted: it has them now; nothing is left to do here.
    """
    from datatrove.executor import SlurmPipelineExecutor

    missing, record = unfinished(job), job.folder / "slurm.json"
    if not missing:
        return
    if record.exists() and (running := json.loads(record.read_text())["job_id"]) and _in_queue(running):
        raise Submitted(f"Slurm job {running} has not ended; {len(missing)} shards are missing. Run this again later.")
    remove_stale(job)
    if shutil.which("sbatch") is None:
        raise SpaceDockError("There is no sbatch here: run this command where jobs of the cluster are submitted.")
    executor = SlurmPipelineExecutor(
        pipeline=[_step_class()(str(job.root.resolve()), missing, config.cpus_per_task)],
        tasks=len(missing),
        workers=num_workers or -1,  # as many at a time as the cluster gives
        logging_dir=str((job.folder / "datatrove" / f"slurm_{time.time_ns()}").resolve()),
        skip_completed=False,
        time=config.time,
        partition=config.partition or "",
        qos=config.qos or "",
        cpus_per_task=config.cpus_per_task,
        mem_per_cpu_gb=config.mem_per_cpu_gb,
        job_name="spacedock",
        env_command=f"export PATH={shlex.quote(str(Path(sys.executable).parent))}:$PATH",
    )
    try:
        executor.run()
    except (OSError, subprocess.CalledProcessError) as error:
        if executor.job_id is None:  # otherwise only the job that adds up datatrove's statistics was refused
            raise SpaceDockError(f"sbatch refused the job: {error}") from error
    write_json(record, {"job_id": executor.job_id})
    raise Submitted(
        f"{len(missing)} tasks are with Slurm (job {executor.job_id}). When they are done run the same command again."
    )


def _in_queue(job_id: str) -> bool:
    if shutil.which("squeue") is None:
        return False
    seen = subprocess.run(["squeue", "--noheader", f"--jobs={job_id}"], capture_output=True, text=True, check=False)
    return seen.returncode == 0 and bool(seen.stdout.strip())


def _step_class() -> type:
    try:
        from datatrove.pipeline.base import PipelineStep
    except ImportError as error:
        raise MissingDependencyError("datatrove is needed: pip install '.[scale]' in SpaceDock's folder") from error

    class WriteShards(PipelineStep):
        """A task of the pipeline: one shard.

        With ``own_process`` it is written by a process of its own: datatrove's Ray worker forks, and waits for ever for
        a fork that was killed; a process that ends badly is an error, which it tries again.
        """

        name = "SpaceDock shards"
        type = "writer"

        def __init__(self, root: str, shards: list[int], threads: int, own_process: bool = False) -> None:
            super().__init__()
            self.root, self.shards, self.threads, self.own_process = root, shards, threads, own_process

        def run(self, data: Any = None, rank: int = 0, world_size: int = 1) -> Any:
            del data
            for index in self.shards[rank::world_size]:
                with self.track_time():
                    if self.own_process:
                        module = "lerobot_spacedock.dataset.shards"
                        subprocess.run(
                            [sys.executable, "-m", module, self.root, str(index), str(self.threads)], check=True
                        )
                    summary = write_shard(self.root, index, encoder_threads=self.threads)
                self.stat_update("frames", value=summary.frames)
            return ()

    return WriteShards
