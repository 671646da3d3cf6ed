"""Runs the shards of a job on the cores of this machine."""

from __future__ import annotations

import contextlib
import functools
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

from tqdm import tqdm

from lerobot_spacedock.dataset.job import Job, Plan
from lerobot_spacedock.dataset.shards import finished, read_summary, remove_stale, write_shard
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.invocation import available_cores

POLL_s = 0.3
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def check_workers(count: int) -> None:
    """Raises InputError for a ``--num_workers`` that is no number of processes."""
    if count < 0:
        raise InputError("--num_workers", count, "0 for one a core, or more")


def run_shards(job: Job, *, num_workers: int, total_frames: int | None) -> None:
    """Writes all shards that are not finished, with a progress bar of frames.

    Args:
        job: with its plan saved.
        num_workers: processes; 1 works in this one, 0 takes one a core.
        total_frames: for the bar, if known.

    Raises:
        SpaceDockError: a shard failed, or a worker died; finished shards stay.
    """
    plan = Plan.read(job.plan_path)
    indices = [index for index in range(plan.num_shards) if not finished(job, index)]
    workers = min(num_workers or available_cores(), max(len(indices), 1))
    already = sum(read_summary(job, i).frames for i in range(plan.num_shards) if finished(job, i))
    for stale in job.progress.iterdir():
        stale.unlink()
    remove_stale(job)
    with tqdm(total=total_frames, initial=already, unit="frame", desc="Writing frames", smoothing=0.1) as bar:
        if workers == 1:
            with _called_now_and_then(lambda: _show(bar, job, already)):
                for index in indices:
                    write_shard(job.root, index)
        else:
            task = functools.partial(write_shard, job.root)
            run_processes(task, indices, workers, lambda: _show(bar, job, already))
        _show(bar, job, already)


def run_processes(
    task: Callable[..., object], items: list[int], workers: int, show: Callable[[], None] = lambda: None
) -> None:
    """Calls ``task(item, encoder_threads=…)`` for each item in processes.

    Args:
        task: picklable.
        items: what it is called with.
        workers: how many processes.
        show: called now and then, and after each item.

    Raises:
        SpaceDockError: a process was killed. What a task raises is raised here.
    """
    threads = max(1, available_cores() // workers)
    with _threads_a_process(threads):
        pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
        try:
            waiting = {pool.submit(task, item, encoder_threads=threads) for item in items}
            while waiting:
                done, _ = wait(waiting, timeout=POLL_s, return_when=FIRST_COMPLETED)
                show()
                for future in done:
                    waiting.remove(future)
                    _raise_of(future)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        pool.shutdown()


@contextlib.contextmanager
def _called_now_and_then(show: Callable[[], None]) -> Iterator[None]:
    """Calls ``show`` from a thread while the block runs."""
    done = threading.Event()

    def work() -> None:
        while not done.wait(POLL_s):
            show()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _raise_of(future: Future) -> None:
    try:
        future.result()
    except BrokenProcessPool as error:
        raise SpaceDockError(
            "A worker process was ended from outside (killed, or out of memory). What is finished is kept: run the "
            "same command again to go on, with fewer --num_workers if memory was short."
        ) from error


@contextlib.contextmanager
def _threads_a_process(threads: int) -> Iterator[None]:
    """Child processes read these when they import their libraries; ours have been imported already."""
    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, str(threads)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _show(bar: tqdm, job: Job, already: int) -> None:
    written = already + sum(file.stat().st_size for file in job.progress.iterdir())
    bar.update(written - bar.n)
