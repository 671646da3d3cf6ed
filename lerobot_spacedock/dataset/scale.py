"""Where the shards of a job are written: this machine's processes, or a datatrove pipeline on it, on Ray or on Slurm.

One shard a task; a shard that is finished is skipped, whoever wrote it, so every way goes on from where any other
stopped. The working folder has to be on a file system that all workers see.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lerobot_spacedock.dataset.job import Job, Plan
from lerobot_spacedock.dataset.shards import finished, write_shard
from lerobot_spacedock.dataset.workers import available_cores, run_shards
from lerobot_spacedock.errors import InputError, MissingDependencyError, SpaceDockError

KINDS = ("processes", "local", "ray", "slurm")


@dataclass(frozen=True)
class ExecutorConfig:
    """Where shards are written. Flags as in ``--executor.kind=ray``."""

    # processes (no further package needed) | local, ray or slurm (datatrove: pip install lerobot_env_spacedock[scale])
    kind: str = "processes"
    # ray: address of a running cluster; left out, one is started here
    ray_address: str | None = None
    # slurm: partition to submit to
    partition: str | None = None
    # slurm: time limit of a task, as sbatch writes it
    time: str = "02:00:00"
    # cores a task may use
    cpus_per_task: int = 1
    # ray and slurm: GB of memory a core
    mem_per_cpu_gb: int = 4
    # how often tasks that failed or were killed are tried again
    retries: int = 2

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("--executor.kind", self.kind, " | ".join(KINDS))
        if self.kind == "slurm" and not self.partition:
            raise InputError("--executor.partition", self.partition, "a partition of the cluster, for slurm")


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
    missing = unfinished(job)
    for attempt in range(config.retries + 1):
        if not missing:
            return
        print(f"{len(missing)} shards to write ({config.kind}, attempt {attempt + 1})")
        _run_pipeline(job, missing, config, num_workers or available_cores(), attempt)
        if config.kind == "slurm":
            raise Submitted(f"{len(missing)} tasks are with Slurm. When they are done run the same command again.")
        missing = unfinished(job)
    if missing:
        raise SpaceDockError(
            f"{len(missing)} shards could not be written; see {job.folder / 'datatrove'}. What is finished stays: run "
            "the same command again, or with --executor.kind=processes to see the error itself."
        )


def unfinished(job: Job) -> list[int]:
    """Indices of the shards that are still to be written."""
    return [index for index in range(Plan.read(job.plan_path).num_shards) if not finished(job, index)]


def _run_pipeline(job: Job, shards: list[int], config: ExecutorConfig, workers: int, attempt: int) -> None:
    step = _step_class()(str(job.root.resolve()), shards, config.cpus_per_task)
    shared: dict[str, Any] = {
        "pipeline": [step],
        "tasks": len(shards),
        "logging_dir": str((job.folder / "datatrove" / f"attempt_{attempt}").resolve()),
        "skip_completed": False,  # a finished shard says so itself
    }
    if config.kind == "local":
        from datatrove.executor import LocalPipelineExecutor

        executor = LocalPipelineExecutor(**shared, workers=min(workers, len(shards)))
    elif config.kind == "ray":
        import ray
        from datatrove.executor.ray import RayPipelineExecutor

        if not ray.is_initialized():
            _start_ray(config.ray_address, workers)
        memory = {"cpus_per_task": config.cpus_per_task, "mem_per_cpu_gb": config.mem_per_cpu_gb}
        executor = RayPipelineExecutor(**shared, **memory, workers=workers)
    else:
        from datatrove.executor import SlurmPipelineExecutor

        executor = SlurmPipelineExecutor(
            **shared,
            time=config.time,
            partition=config.partition,
            cpus_per_task=config.cpus_per_task,
            mem_per_cpu_gb=config.mem_per_cpu_gb,
            workers=workers,
            job_name="spacedock",
        )
    try:
        executor.run()
    except Exception as error:  # a failed or killed task; unfinished() tells which, and retries follow
        print(f"  {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}")


def _start_ray(address: str | None, workers: int) -> None:
    import ray

    try:
        ray.init(address=address, num_cpus=None if address else workers)
    except Exception as error:  # Ray raises plain Exception for a node that did not come up
        raise SpaceDockError(
            f"Ray could not be {'reached at ' + address if address else 'started'}: {error}"
        ) from error


def _step_class() -> type:
    try:
        from datatrove.pipeline.base import PipelineStep
    except ImportError as error:
        raise MissingDependencyError("datatrove is needed: pip install 'lerobot_env_spacedock[scale]'") from error

    class WriteShards(PipelineStep):
        """A task of the pipeline: one shard."""

        name = "SpaceDock shards"
        type = "writer"

        def __init__(self, root: str, shards: list[int], threads: int) -> None:
            super().__init__()
            self.root, self.shards, self.threads = root, shards, threads

        def run(self, data: Any = None, rank: int = 0, world_size: int = 1) -> Any:
            del data
            for index in self.shards[rank::world_size]:
                with self.track_time():
                    summary = write_shard(self.root, index, encoder_threads=self.threads)
                self.stat_update("frames", value=summary.frames)
            return ()

    return WriteShards
