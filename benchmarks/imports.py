"""What the package adds to the start of a LeRobot command, in seconds of processor time.

    python benchmarks/imports.py [--repeats 5]

Each repeat is a new process that imports what `lerobot-train` and `lerobot-eval` import, then what their plugin
discovery loads of this package (`lerobot_env_spacedock`); and one that imports the package alone. The aim is less
than 0.3 s on top of LeRobot's own.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys

from table import Row, show

DISCOVERY = """
import sys, time
start = time.process_time()
import lerobot.scripts.lerobot_eval
middle = time.process_time()
import lerobot_env_spacedock
print(middle - start, time.process_time() - middle, "numba" in sys.modules)
"""
ALONE = """
import time
start = time.process_time()
import lerobot_spacedock
print(time.process_time() - start, 0.0, False)
"""


def measure(code: str, repeats: int) -> tuple[float, float]:
    """Medians of the two times that ``code`` prints, s of processor time, over new processes."""
    runs = []
    for _ in range(repeats):
        shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        first, second, numba = shown.split()
        if numba == "True" and code is DISCOVERY:
            print("note: LeRobot's imports brought in numba")
        runs.append((float(first), float(second)))
    return statistics.median(r[0] for r in runs), statistics.median(r[1] for r in runs)


def rows(quick: bool = False) -> list[Row]:
    """Discovery beside LeRobot's own imports."""
    repeats = 2 if quick else 5
    lerobot, plugin = measure(DISCOVERY, repeats)
    alone, _ = measure(ALONE, repeats)
    return [
        Row("import: what LeRobot's discovery loads of this package", plugin, "s", "LeRobot's own imports", lerobot),
        Row("import: `import lerobot_spacedock` alone", alone, "s", "LeRobot's own imports", lerobot),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    show(rows(parser.parse_args().quick))
