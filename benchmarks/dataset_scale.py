"""Does memory grow with the dataset, and what would a million episodes cost?

    python benchmarks/dataset_scale.py --episodes=10,100,1000,10000

For each size: ``spacedock demos``, then ``spacedock convert`` of its logs, then ``spacedock check`` of what that wrote,
each in one process of its own, whose peak resident memory the system tells. The last table extrapolates the rates of
the largest size.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

MILLION = 1_000_000


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
    parser.add_argument("--episodes", default="10,100,1000")
    parser.add_argument("--height", type=int, default=0, help="of the frames; 0 writes states and actions alone")
    parser.add_argument("--width", type=int, default=0)
    parser.add_argument("--expert", default="V")
    parser.add_argument("--scratch", default=None, help="folder for what is written and removed again")
    arguments = parser.parse_args()
    picture = [f"--camera.height={arguments.height}", f"--camera.width={arguments.width}"] if arguments.height else None
    print(f"{'verb':8s} {'episodes':>8s} {'peak MB':>8s} {'wall s':>8s} {'CPU s':>8s} {'disk MB':>8s}", flush=True)
    runs: list[Run] = []
    for count in map(int, arguments.episodes.split(",")):
        with tempfile.TemporaryDirectory(dir=arguments.scratch) as scratch:
            runs += measure_size(Path(scratch), count, arguments.expert, picture)
    print(f"\na million episodes on one core, by the rates at {runs[-1].episodes}:")
    for run in runs[-3:]:
        scale = MILLION / run.episodes
        print(f"{run.verb:8s} {run.cpu_s * scale / 3600.0:8.1f} core hours {run.disk_MB * scale / 1e3:8.1f} GB")


def measure_size(folder: Path, count: int, expert: str, picture: list[str] | None) -> list[Run]:
    """The three verbs over ``count`` episodes; what they wrote is removed."""
    logs, flown, converted = folder / "logs", folder / "flown", folder / "converted"
    common = ["--repo_id=bench/scale", "--num_workers=1"]
    demos = [f"--root={flown}", f"--expert={expert}", f"--num_episodes={count}", f"--num_candidates={count}"]
    runs = [
        measure("demos", count, [*common, *demos, f"--log_dir={logs}", *(picture or ["--image=false"])], flown),
    ]
    shutil.rmtree(flown)
    convert = [f"--root={converted}", f"--source={logs}", *(picture or ["--images=none"])]
    runs.append(measure("convert", count, [*common, *convert], converted))
    runs.append(measure("check", count, [f"--root={converted}"], converted))
    return runs


def measure(verb: str, count: int, flags: list[str], dataset: Path) -> Run:
    """Runs one verb and prints what it took.

    Raises:
        RuntimeError: it failed.
    """
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "lerobot_spacedock.cli", verb, *flags],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"spacedock {verb} {' '.join(flags)} ended with {process.returncode}")
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
