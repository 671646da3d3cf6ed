"""Time and peak memory of a report over the number of episodes: reading the logs alone, and the whole command.

    python benchmarks/report.py --episodes 100 1000 10000

Logs are written to a temporary folder first (65 steps each, not timed). ``--part read`` measures reading them into
columns; the floor in its last column is reading the same Parquet files without computing anything. ``--part report``
measures ``spacedock report`` from its start to its end: tables, bootstrap, figures, page.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

STEPS = 65
READ = """
import resource, sys, time
from pathlib import Path
from lerobot_spacedock.metrics.collect import collect
if __name__ == "__main__":
    files = sorted(Path(sys.argv[1]).glob("episode_*.parquet"))[: int(sys.argv[2])]
    start = time.perf_counter()
    sets, excluded = collect([files])
    seconds = time.perf_counter() - start
    assert sum(map(len, sets.values())) == len(files) and not excluded
    own, workers = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = own.ru_utime + own.ru_stime + workers.ru_utime + workers.ru_stime
    print(seconds, cpu, own.ru_maxrss / 1024, workers.ru_maxrss / 1024)
"""


REPORT = """
import resource, sys, time
start = time.perf_counter()
from lerobot_spacedock.cli import main
if __name__ == "__main__":
    assert main(["report", "--runs", "A=" + sys.argv[1], "--out=" + sys.argv[3]]) == 0
    seconds = time.perf_counter() - start
    own, workers = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = own.ru_utime + own.ru_stime + workers.ru_utime + workers.ru_stime
    print()
    print(seconds, cpu, own.ru_maxrss / 1024, workers.ru_maxrss / 1024)
"""
HEADS = {
    "read": ("episodes", "s", "CPU s, imports in it", "peak memory, MB", "of a worker, MB", "Parquet alone, s"),
    "report": ("episodes", "s", "CPU s", "peak memory, MB", "of a worker, MB"),
}


def write_logs(folder: Path, count: int) -> None:
    """``count`` logs: 200 different ones, then copies under other names."""
    from lerobot_spacedock.episode_log import EpisodeLog, log_path, write_episode_log

    rng = np.random.default_rng(0)
    for seed in range(min(count, 200)):
        dt = rng.normal(0.907, 0.077, STEPS).clip(0.6, 1.25)
        state = np.cumsum(rng.normal(0, 0.05, (STEPS + 1, 14)), axis=0)
        state[:, 1] += np.linspace(-25.0, 0.0, STEPS + 1)
        state[:, 6], state[:, 7:11] = 1000.0, (0.5**0.5, -(0.5**0.5), 0.0, 0.0)
        time_s = np.concatenate([[0.0], np.cumsum(dt)])
        action = rng.normal(0, 5.0, (STEPS, 6))
        log = EpisodeLog(time_s, state, action, dt, np.zeros(STEPS), {"initial_conditions": "same"})
        write_episode_log(log_path(folder, seed), log)
    for seed in range(200, count):
        shutil.copyfile(log_path(folder, seed % 200), log_path(folder, seed))


def floor_seconds(files: list[Path]) -> float:
    """s to read the files with pyarrow alone, in one process."""
    import pyarrow.parquet as pq

    start = time.perf_counter()
    for path in files:
        with pq.ParquetFile(path) as file:
            file.read(use_threads=False)
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, nargs="+", default=[100, 1000, 10_000])
    parser.add_argument("--part", choices=("read", "report"), default="read")
    parser.add_argument("--keep", type=Path, help="write the logs here, and find them here the next time")
    options = parser.parse_args()
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    head = HEADS[options.part]
    with tempfile.TemporaryDirectory() as name:
        script = Path(name) / "measure.py"
        script.write_text(READ if options.part == "read" else REPORT)
        print("| " + " | ".join(head) + " |\n|" + "--:|" * len(head), flush=True)
        for count in sorted(options.episodes):
            folder = (options.keep or Path(name)) / f"logs_{count}"
            if not folder.is_dir():
                write_logs(folder, count)
            command = [sys.executable, str(script), str(folder), str(count), str(Path(name) / "out")]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            seconds, cpu, own, worker = map(float, done.stdout.split("\n")[-2].split())
            cells = [f"{count:,}", f"{seconds:.1f}", f"{cpu:.1f}", f"{own:.0f}", f"{worker:.0f}"]
            if options.part == "read":
                cells.append(f"{floor_seconds(sorted(folder.glob('*.parquet'))):.1f}")
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
