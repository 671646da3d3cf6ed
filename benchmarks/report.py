"""Time and peak memory of reading episode logs into a report's columns, over the number of episodes.

    python benchmarks/report.py --episodes 100 1000 10000

Logs are written to a temporary folder first (65 steps each, not timed). The floor in the last column is reading the
same Parquet files without computing anything.
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
MEASURE = """
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, nargs="+", default=[100, 1000, 10_000])
    counts = sorted(parser.parse_args().episodes)
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    print("| episodes | s | CPU s, imports in it | peak memory, MB | of a worker, MB | Parquet alone, one process, s |")
    print("|--:|--:|--:|--:|--:|--:|")
    with tempfile.TemporaryDirectory() as name:
        folder, script = Path(name) / "logs", Path(name) / "measure.py"
        write_logs(folder, counts[-1])
        script.write_text(MEASURE)
        for count in counts:
            command = [sys.executable, str(script), str(folder), str(count)]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            seconds, cpu, own, worker = map(float, done.stdout.split())
            floor = floor_seconds(sorted(folder.glob("*.parquet"))[:count])
            print(f"| {count:,} | {seconds:.1f} | {cpu:.1f} | {own:.0f} | {worker:.0f} | {floor:.1f} |")


if __name__ == "__main__":
    main()
