"""Does memory grow with the dataset, and what would a million episodes cost?

    python benchmarks/dataset_scale.py --episodes=10,100,1000 --assemble=100,1000,10000

For each size: ``spacedock demos``, then ``spacedock convert`` of its logs, then ``spacedock check`` of what that wrote,
each in one process of its own, whose peak resident memory the system tells. The last table takes what an episode costs
from the two largest sizes, so that start-up does not count.

Writing takes one shard after the other, so its memory is that of a shard; what sees the whole dataset is putting the
shards together, and the check. ``--assemble`` measures these two with copies of one shard of 50 episodes, states alone.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

MILLION = 1_000_000
SHARD_EPISODES = 50


@dataclass(frozen=True)
class Run:
    """One command, measured.

    Attributes:
        verb: of ``spacedock``.
        episodes: how many it handled.
        peak_MB: largest resident memory of its process.
        wall_s: from start to end.
        cpu_s: user and system time.
        disk_MB: of the dataset it wrote, or read.
    """

    verb: str
    episodes: int
    peak_MB: float
    wall_s: float
    cpu_s: float
    disk_MB: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", default="10,100")
    parser.add_argument("--assemble", default="", help="sizes at which copies of a shard are put together")
    parser.add_argument("--height", type=int, default=0, help="of the frames; 0 writes states and actions alone")
    parser.add_argument("--width", type=int, default=0)
    parser.add_argument("--expert", default="V")
    parser.add_argument("--flags", default="", help="further flags of demos and convert, in one string")
    parser.add_argument("--scratch", default=None, help="folder for what is written and removed again")
    arguments = parser.parse_args()
    picture = [f"--camera.height={arguments.height}", f"--camera.width={arguments.width}"] if arguments.height else None
    print(f"{'verb':8s} {'episodes':>8s} {'peak MB':>8s} {'wall s':>8s} {'CPU s':>8s} {'disk MB':>8s}", flush=True)
    runs: list[Run] = []
    for count in map(int, filter(None, arguments.episodes.split(","))):
        with tempfile.TemporaryDirectory(dir=arguments.scratch) as scratch:
            runs += measure_size(Path(scratch), count, arguments.expert, picture, shlex.split(arguments.flags))
    for count in map(int, filter(None, arguments.assemble.split(","))):
        with tempfile.TemporaryDirectory(dir=arguments.scratch) as scratch:
            runs += measure_assembly(Path(scratch) / "dataset", count)
    for verb in dict.fromkeys(run.verb for run in runs):
        sizes = sorted((run for run in runs if run.verb == verb), key=lambda run: run.episodes)
        if len(sizes) < 2:
            continue
        few, many = sizes[-2:]
        each = MILLION / (many.episodes - few.episodes)
        cost = f"{(many.cpu_s - few.cpu_s) * each / 3600.0:8.1f} core hours"
        print(f"a million episodes, {verb:8s} {cost} {(many.disk_MB - few.disk_MB) * each / 1e3:8.1f} GB")


def measure_size(folder: Path, count: int, expert: str, picture: list[str] | None, flags: list[str]) -> list[Run]:
    """The three verbs over ``count`` episodes; what they wrote is removed."""
    logs, flown, converted = folder / "logs", folder / "flown", folder / "converted"
    common = ["--repo_id=bench/scale", "--num_workers=1", *flags]
    cli = ["-m", "lerobot_spacedock.cli"]
    demos = [f"--root={flown}", f"--expert={expert}", f"--num_episodes={count}", f"--num_candidates={count}"]
    demos += [f"--log_dir={logs}", *(picture or ["--image=false"])]
    runs = [measure("demos", count, [*cli, "demos", *common, *demos], flown)]
    shutil.rmtree(flown)
    convert = [f"--root={converted}", f"--source={logs}", *(picture or ["--images=none"])]
    runs.append(measure("convert", count, [*cli, "convert", *common, *convert], converted))
    runs.append(measure("check", count, [*cli, "check", f"--root={converted}"], converted))
    return runs


def measure_assembly(root: Path, count: int) -> list[Run]:
    """Puts ``count`` / 50 copies of one shard together, and checks the result (which finds the duplicates)."""
    # in a process of its own: a child's peak counts what its parent held when it was started
    worker = multiprocessing.get_context("spawn").Process(target=prepare, args=(root, count))
    worker.start()
    worker.join()
    if worker.exitcode != 0:
        raise RuntimeError(f"preparing {count} episodes ended with {worker.exitcode}")
    code = "import sys; from pathlib import Path; from lerobot_spacedock.dataset.assemble import assemble; "
    code += "from lerobot_spacedock.dataset.job import Job; assemble(Job(Path(sys.argv[1])))"
    return [
        measure("assemble", count, ["-c", code, str(root)], root),
        measure("check", count, ["-m", "lerobot_spacedock.cli", "check", f"--root={root}"], root, allowed=(0, 1)),
    ]


def prepare(root: Path, count: int) -> None:
    """A job at ``root`` with all shards finished: copies of one."""
    import numpy as np

    from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig
    from lerobot_spacedock.dataset.flight import fly
    from lerobot_spacedock.dataset.job import Job, Plan
    from lerobot_spacedock.dataset.record import DatasetLayout
    from lerobot_spacedock.dataset.shards import write_shard
    from lerobot_spacedock.dataset.sources import EpisodeRef
    from lerobot_spacedock.env.config import SpaceDockConfig
    from lerobot_spacedock.env.registration import ENV_IDS
    from lerobot_spacedock.episode_log import log_path, write_episode_log
    from lerobot_spacedock.expert.feedback import FeedbackPolicy

    env = SpaceDockConfig(**ENV_IDS["SpaceDockContact-v0"])
    seeds = np.arange(100_000, 100_000 + SHARD_EPISODES)
    calm = Disturbance.draw(seeds, env.max_steps, KickConfig(), NoiseConfig())
    job = Job(root)
    job.begin({})
    refs = []
    for log in fly(FeedbackPolicy("V", hill_coupling=True), env, seeds, calm):
        path = log_path(job.flights, log.metadata["seed"])
        write_episode_log(path, log)
        refs.append(EpisodeRef("logs", str(path)))
    plan = Plan(DatasetLayout("bench/scale", image=False), 1)
    job.write_plan(plan, refs)
    write_shard(root, 0)
    replace(plan, num_shards=count // SHARD_EPISODES).save(job.plan_path)
    for index in range(1, count // SHARD_EPISODES):
        shutil.copytree(job.shard(0), job.shard(index))


def measure(verb: str, count: int, arguments: list[str], dataset: Path, allowed: tuple[int, ...] = (0,)) -> Run:
    """Runs Python with these arguments and prints what it took.

    Raises:
        RuntimeError: it failed.
    """
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in allowed:
        raise RuntimeError(f"{' '.join(arguments)} ended with {process.returncode}")
    run = Run(
        verb,
        count,
        usage.ru_maxrss * 1024 / 1e6,  # Linux counts kibibytes
        time.perf_counter() - start,
        usage.ru_utime + usage.ru_stime,
        sum(file.stat().st_size for file in dataset.rglob("*") if file.is_file()) / 1e6,
    )
    print(f"{verb:8s} {count:8d} {run.peak_MB:8.0f} {run.wall_s:8.1f} {run.cpu_s:8.1f} {run.disk_MB:8.1f}", flush=True)
    return run


if __name__ == "__main__":
    main()
