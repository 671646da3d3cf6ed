"""Demonstrations a minute, and environments with a camera side by side.

    python benchmarks/flights.py [--quick]

`spacedock demos` from its start to the finished dataset, beside drawing its frames alone; and LeRobot's vector
environment of this package (`--env.type=spacedock`, one process) from 1 to 16 environments, in frames a second, beside
the renderer alone. Frames of 96 × 128.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from table import Row, show

from lerobot_spacedock.adapters.env_config import SpaceDockEnvConfig
from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer
from lerobot_spacedock.camera.contact_sheet import port_pose
from lerobot_spacedock.dataset.demos import DemosConfig, demos
from lerobot_spacedock.dataset.record import Storage

CAMERA = CameraConfig(height=96, width=128)


def frame_seconds(repeats: int = 3) -> float:
    """Seconds a frame, over an approach."""
    renderer = make_renderer(CAMERA)
    poses = [port_pose("zvezda_aft", float(d)) for d in np.linspace(25.0, 0.2, 40)]
    renderer.render(*poses[0], FIXED_SUN_H["zvezda_aft"])
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        for pose in poses:
            renderer.render(*pose, FIXED_SUN_H["zvezda_aft"])
        times.append((time.perf_counter() - start) / len(poses))
    return min(times)


def demonstrations(count: int, storage: str) -> tuple[float, int]:
    """Seconds and frames of a dataset of ``count`` episodes."""
    scratch = Path(tempfile.mkdtemp())
    try:
        config = DemosConfig(
            repo_id="spacedock/bench", root=str(scratch / "set"), num_episodes=count, num_candidates=count,
            expert="meta_rl", camera=CAMERA, storage=Storage(kind=storage),
        )  # fmt: skip
        start = time.perf_counter()
        with contextlib.redirect_stdout(sys.stderr):  # stdout is the table's
            demos(config)
        seconds = time.perf_counter() - start
        from lerobot.datasets.lerobot_dataset import LeRobotDatasetMetadata

        return seconds, LeRobotDatasetMetadata(config.repo_id, config.root).total_frames
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def vector_rate(count: int, steps: int) -> float:
    """Frames a second of ``count`` environments stepped together."""
    config = SpaceDockEnvConfig(task="SpaceDockContact-v0", camera=CAMERA)
    env = next(iter(next(iter(config.create_envs(count).values())).values()))
    env.reset(seed=list(range(count)))
    action = np.zeros((count, 6), dtype=np.float32)
    env.step(action)
    start = time.perf_counter()
    for _ in range(steps):
        env.step(action)
    seconds = time.perf_counter() - start
    env.close()
    return count * steps / seconds


def rows(quick: bool = False) -> Iterator[Row]:
    """Both."""
    frame = frame_seconds()
    for storage in ("image", "video"):
        count = 4 if quick else 16
        seconds, frames = demonstrations(count, storage)
        yield Row(
            f"demonstrations a minute, {storage}", 60.0 * count / seconds, "1/min", "drawing their frames alone",
            60.0 * count / (frames * frame),
        )  # fmt: skip
    for count in (1, 2, 4, 8, 16):
        rate = vector_rate(count, max(2, (16 if quick else 48) // count))
        yield Row(f"env steps with frame, {count} environments", rate, "1/s", "the renderer alone", 1.0 / frame)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    show(rows(parser.parse_args().quick))
