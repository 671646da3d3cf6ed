"""Thousands of episodes with pictures in one process: memory, files, threads and processes must not grow.

    python tests/faults/soak.py --episodes=2000
    PYOPENGL_PLATFORM=egl python tests/faults/soak.py --episodes=500 --renderer=pyrender

The feedback law V docks in ``SpaceDockContact-v0``, Sun and start drawn anew each time; every frame is drawn
and every episode logged. The environment is closed and made again every few episodes, where a renderer that is not
given back would show. A line each hundred episodes, then the slope of the resident memory, fitted from the first
quarter on. Exit status 1 where anything grew.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import psutil
from scipy.stats import linregress

import lerobot_spacedock  # noqa: F401 - registers the ids
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.expert.controllers import make_expert

EPISODES_PER_ENV = 20
MOST_KiB_PER_EPISODE = 8.0  # 2,000 episodes: 16 MiB, half a per cent of what LeRobot holds


@dataclass(frozen=True)
class Sample:
    """What the process holds after so many episodes."""

    episodes: int
    memory_KiB: float
    files: int
    threads: int
    children: int

    @classmethod
    def take(cls, episodes: int) -> Sample:
        process = psutil.Process()
        counts = (process.num_fds(), process.num_threads(), len(process.children(recursive=True)))
        return cls(episodes, process.memory_info().rss / 1024.0, *counts)


def soak(episodes: int, *, every: int, height: int, width: int, renderer: str) -> list[Sample]:
    """Flies them; a sample each ``every`` episodes."""
    law = make_expert("V", TaskConfig(contact=True, hill_coupling=True))
    camera = {"height": height, "width": width}
    samples: list[Sample] = []
    start = time.monotonic()
    for first in range(0, episodes, EPISODES_PER_ENV):
        with tempfile.TemporaryDirectory() as folder:
            options = {"initial_conditions": "random", "sun": "random", "renderer": renderer, "camera": camera}
            with gym.make("SpaceDockContact-v0", log_dir=folder, **options) as env:
                for seed in range(first, min(first + EPISODES_PER_ENV, episodes)):
                    outcome = fly(env, law, seed)
                    if (seed + 1) % every == 0:
                        samples.append(Sample.take(seed + 1))
                        print(f"| {row(samples[-1])} | {outcome} | {time.monotonic() - start:.0f} |", flush=True)
            assert len(os.listdir(folder)) == min(EPISODES_PER_ENV, episodes - first)
    return samples


def fly(env: gym.Env, law, seed: int) -> str:
    """One episode; how it ended."""
    observation, _ = env.reset(seed=seed)
    law.reset(1)
    while True:
        action = law.act(observation["agent_pos"][None].astype(np.float64))[0]
        observation, _, terminated, truncated, info = env.step(action.astype(np.float32))
        if terminated or truncated:
            return info["outcome"]


def row(sample: Sample) -> str:
    counts = (sample.episodes, f"{sample.memory_KiB / 1024:.1f}", sample.files, sample.threads, sample.children)
    return " | ".join(str(value) for value in counts)


def judge(samples: list[Sample]) -> list[str]:
    """What grew, from the first quarter on; the slope is printed."""
    kept = samples[len(samples) // 4 :]
    fit = linregress([s.episodes for s in kept], [s.memory_KiB for s in kept])
    print(f"memory: {fit.slope:+.2f} ± {fit.stderr:.2f} KiB an episode, over {kept[0].episodes} to {kept[-1].episodes}")
    grown = [name for name in ("files", "threads", "children") if getattr(kept[-1], name) > getattr(kept[0], name)]
    return grown + (["memory"] if fit.slope - 2.0 * fit.stderr > MOST_KiB_PER_EPISODE else [])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--every", type=int, default=100, help="episodes between two lines")
    parser.add_argument("--height", type=int, default=96, help="pixels")
    parser.add_argument("--width", type=int, default=128, help="pixels")
    parser.add_argument("--renderer", default="software", help="software | pyrender")
    options = parser.parse_args()
    if options.episodes < 4 * options.every:
        parser.error("--episodes: at least four times --every, for a slope")
    print("| episodes | memory, MiB | files | threads | processes | the last one | s |\n|--:|--:|--:|--:|--:|:--|--:|")
    grown = judge(soak(**vars(options)))
    print("grew: " + (", ".join(grown) or "nothing"))
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
