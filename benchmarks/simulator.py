"""Simulator speed, env-steps a second, as ratios within one run.

    python benchmarks/simulator.py [--batches 1 256 4096 65536] [--seconds 1.0] [--json FILE]

Beside each other at every batch size: this package's dynamics alone and its whole environment (observation, noise,
reward, automatic reset), V-BAR's vector environment (`pip install vbar`; a point mass with constraints), and a plain
NumPy loop over the same equations of motion (one Runge–Kutta step of order 4).
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np
from table import Row

import lerobot_spacedock  # noqa: F401
from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.chaser import ChaserParameters
from lerobot_spacedock.physics.constants import CHASER_INERTIA_kg_m2, MEAN_MOTION_rad_s
from lerobot_spacedock.physics.propagate import propagate

STEP_s = 0.9


def rate(step: Callable[[], object], batch: int, seconds: float) -> float:
    """Best of five windows, env-steps a second of wall time."""
    step()
    best = 0.0
    for _ in range(5):
        count, start = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - start) < seconds / 5:
            step()
            count += 1
        best = max(best, count * batch / elapsed)
    return best


def commands(batch: int) -> list[np.ndarray]:
    """Commands of a few steps, flown in turn; ever the same torque would only measure chasers that spin."""
    generator = np.random.default_rng(0)
    return [generator.uniform(-1, 1, (batch, 6)) * [20, 20, 20, 0.5, 0.5, 0.5] for _ in range(16)]


def numpy_step(state: np.ndarray, action: np.ndarray) -> np.ndarray:
    """RK4 over HCW, a turning thrust and an isotropic rigid body, in vectorised NumPy."""
    n = MEAN_MOTION_rad_s

    def rates(s: np.ndarray) -> np.ndarray:
        r, v, q, w = s[:, :3], s[:, 3:6], s[:, 7:11], s[:, 11:]
        a = rotations.rotate(q, action[:, :3]) / s[:, 6:7]
        a[:, 0] += 3 * n * n * r[:, 0] + 2 * n * v[:, 1]
        a[:, 1] -= 2 * n * v[:, 0]
        a[:, 2] -= n * n * r[:, 2]
        spin = np.concatenate([np.zeros((len(s), 1)), w], axis=1)
        flow = -np.linalg.norm(action[:, :3], axis=1, keepdims=True) / 2943.0
        return np.concatenate(
            [v, a, flow, 0.5 * rotations.multiply(q, spin), action[:, 3:] / CHASER_INERTIA_kg_m2], axis=1
        )

    k1 = rates(state)
    k2 = rates(state + 0.5 * STEP_s * k1)
    k3 = rates(state + 0.5 * STEP_s * k2)
    k4 = rates(state + STEP_s * k3)
    return state + STEP_s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def measure(batch: int, seconds: float, threads: int) -> dict[str, float]:
    bank = commands(batch)
    action, turns = bank[0], itertools.cycle(bank)
    results = {}
    start = BatchedSpaceDock(batch)
    start.reset(np.arange(batch))
    state, parameters = start.sim.state.copy(), ChaserParameters.nominal().pack()
    for used in sorted({1, threads}):
        results[f"dynamics, {used} thread(s)"] = rate(
            lambda used=used: propagate(state, action, STEP_s, parameters, threads=used), batch, seconds
        )
        for name, config in (
            ("whole env", TaskConfig(contact=True, hill_coupling=True, max_steps=100)),
            ("whole env, meta", TaskConfig(contact=True, hill_coupling=True, max_steps=100, dynamics="meta")),
        ):
            env = BatchedSpaceDock(batch, config, threads=used, auto_reset=True)
            env.reset(np.arange(batch))
            results[f"{name}, {used} thread(s)"] = rate(lambda env=env: env.step(next(turns)), batch, seconds)
    results["NumPy RK4, dynamics"] = rate(lambda: numpy_step(state, action), batch, seconds)
    vbar_rate = _vbar(batch, seconds)
    if vbar_rate:
        results["V-BAR vector env"] = vbar_rate
    if batch == 1:
        results["gymnasium step, no frame"] = _single(seconds)
    return results


def _single(seconds: float) -> float:
    env = gym.make("SpaceDockContact-v0", obs_type="agent_pos", disable_env_checker=True)
    env.reset(seed=0)
    action = np.float32([0, 0, 1, 0, 0, 0])

    def step() -> None:
        *_, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return rate(step, 1, seconds)


def _vbar(batch: int, seconds: float) -> float | None:
    try:
        from vbar.scenarios.vector import ApproachVectorEnv
    except ImportError:
        return None
    if batch > 4096:
        return None  # its reset makes one Python object a copy: minutes
    env = ApproachVectorEnv(num_envs=batch)
    env.reset(seed=0)
    action = np.zeros((batch, 3))
    return rate(lambda: env.step(action), batch, seconds)


def rows(quick: bool = False) -> Iterator[Row]:
    """The benchmarks' table: dynamics and whole environment over the batch, beside NumPy and V-BAR."""
    threads = os.cpu_count() or 1
    for batch in (1, 256, 4096) if quick else (1, 256, 4096, 65536):
        rates = measure(batch, 0.2 if quick else 1.0, threads)
        floor = rates["NumPy RK4, dynamics"]
        for name in (f"dynamics, {threads} thread(s)", f"whole env, meta, {threads} thread(s)"):
            yield Row(f"simulator: {name}, batch {batch:,}", rates[name], "steps/s", "NumPy loop, dynamics", floor)
        if "V-BAR vector env" in rates:
            ours, peer = rates[f"whole env, {threads} thread(s)"], rates["V-BAR vector env"]
            yield Row(f"simulator: whole env, batch {batch:,}", ours, "steps/s", "V-BAR, a point mass", peer)
        if "gymnasium step, no frame" in rates:
            yield Row("simulator: one gymnasium step, no frame", rates["gymnasium step, no frame"], "steps/s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 256, 4096, 65536])
    parser.add_argument("--seconds", type=float, default=1.0, help="per measurement")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    results = {batch: measure(batch, args.seconds, args.threads) for batch in args.batches}
    names = list(dict.fromkeys(name for row in results.values() for name in row))
    print(f"env-steps a second (and, in brackets, times the NumPy loop's); load average {os.getloadavg()[0]:.1f}\n")
    print("| | " + " | ".join(f"batch {b:,}" for b in results) + " |")
    print("|---" * (len(results) + 1) + "|")
    for name in names:
        cells = []
        for row in results.values():
            floor = row["NumPy RK4, dynamics"]
            cells.append(f"{row[name]:.3g} ({row[name] / floor:.2g} ×)" if name in row else "–")
        print(f"| {name} | " + " | ".join(cells) + " |")
    if args.json:
        args.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
