"""CPU time of one camera frame, beside pyrender, an empty OpenGL frame and gym-aloha, in one run.

python benchmarks/frame.py [--quick] [--startup] [--memory]

CPU time (all threads of the process) is reported, because it says what a frame costs on a busy machine too; the mean
over 10 poses from 25 m to 0.2 m, each the best of several repeats. On an idle machine the software renderer's wall time
equals its CPU time. ``--startup`` times the first frame of a new process with warm and with empty caches, ``--memory``
measures 16 environments in one process and in 16 processes; neither prints the table.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import numpy as np
from table import Row

from lerobot_spacedock.adapters import SpaceDockEnvConfig
from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer
from lerobot_spacedock.camera.contact_sheet import port_pose
from lerobot_spacedock.errors import MissingDependencyError
from lerobot_spacedock.physics.frames import POSITION, QUATERNION

DISTANCES_m = (25.0, 20.0, 15.0, 10.0, 7.0, 4.0, 2.0, 1.0, 0.5, 0.2)
SIZES = ((480, 640), (240, 320), (96, 128))
TARGET_FPS = {(480, 640): 60, (240, 320): 180, (96, 128): 500}
SUN = FIXED_SUN_H["zvezda_aft"]
ENVS = 16
STEPS = 60  # of an episode's 65

FIRST_FRAME = """
import os, time; t = time.perf_counter()
from lerobot_spacedock.camera import FIXED_SUN_H, make_renderer
from lerobot_spacedock.camera.contact_sheet import port_pose
make_renderer().render(*port_pose("zvezda_aft", 10.0), FIXED_SUN_H["zvezda_aft"])
cpu, cpus = sum(os.times()[:4]), len(os.sched_getaffinity(0))  # helper processes included
print(f"{time.perf_counter() - t:.1f} s wall, {cpu:.1f} s CPU, on {cpus} CPUs")
"""


def cpu_ms(draw, repeats: int) -> float:
    """CPU time of ``draw(pose)``, ms: best of ``repeats``, mean over all poses."""
    poses = [port_pose("zvezda_aft", d) for d in DISTANCES_m]
    for pose in poses[:2]:
        draw(pose)
    best = []
    for pose in poses:
        times = []
        for _ in range(repeats):
            start = time.process_time()
            draw(pose)
            times.append((time.process_time() - start) * 1e3)
        best.append(min(times))
    return statistics.mean(best)


def ours(backend: str, size, repeats: int, **options) -> float:
    """CPU time of a frame of one of the package's renderers, ms."""
    renderer = make_renderer(CameraConfig(height=size[0], width=size[1], **options), backend=backend)
    return cpu_ms(lambda pose: renderer.render(*pose, SUN), repeats)


def env_step(size, repeats: int) -> float:
    """CPU time of an environment's step with its frame, ms; prints its ratio to the same flight's frames alone."""
    env = gymnasium.make("SpaceDock-v0", camera={"height": size[0], "width": size[1]})
    renderer = make_renderer(CameraConfig(height=size[0], width=size[1]))
    action = np.zeros(env.action_space.shape, np.float32)
    states, step, frame = [], [], []
    for _ in range(repeats):
        env.reset(seed=0)
        for _ in range(STEPS):
            start = time.process_time()
            info = env.step(action)[-1]
            step.append((time.process_time() - start) * 1e3)
            states.append((info["state"][POSITION], info["state"][QUATERNION], info["sun_H"]))
            # in turns, on one clock; an earlier state's, because what was just drawn is in the caches
            if len(states) > STEPS // 2:
                start = time.process_time()
                renderer.render(*states[-1 - STEPS // 2])
                frame.append((time.process_time() - start) * 1e3)
    whole, part = statistics.median(step), statistics.median(frame)
    said = f"  at {size}: step with frame {whole:.2f} ms, its frame alone {part:.2f} ms, {whole / part:.3f} x"
    print(said, file=sys.stderr)  # stdout is the table's
    env.close()
    return whole


def empty_gl(size, repeats: int) -> float:
    """CPU time of clearing an OpenGL frame and reading it back through pyrender, ms: the floor of any such back end."""
    import pyrender

    from lerobot_spacedock.camera import pyrender_backend as gl

    stage = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
    stage.main_camera_node = stage.add(pyrender.PerspectiveCamera(yfov=1.0))
    return cpu_ms(lambda _: gl._on_gl_thread(lambda: gl._offscreen(size[1], size[0]).render(stage)), repeats)


def aloha(size, repeats: int) -> float:
    """CPU time of a frame of gym-aloha's camera, ms (``pip install gym-aloha``; MUJOCO_GL=egl without a display)."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    import gym_aloha  # noqa: F401

    env = gymnasium.make("gym_aloha/AlohaInsertion-v0", obs_type="pixels")
    env.reset(seed=0)
    physics = env.unwrapped._env.physics
    return cpu_ms(lambda _: physics.render(height=size[0], width=size[1], camera_id="top"), repeats)


def table(quick: bool) -> None:
    """Print frame times by renderer and size, each with its ratio to the default renderer's."""
    rows = [
        ("software, low, 4 samples", lambda s, n: ours("software", s, n)),
        ("software, low, 1 sample", lambda s, n: ours("software", s, n, samples=1)),
        ("software, high, 4 samples", lambda s, n: ours("software", s, n, detail="high")),
        ("environment step", env_step),
    ]
    if not quick:
        rows += [
            ("pyrender, shadow map", lambda s, n: ours("pyrender", s, 1)),
            ("pyrender, no shadow", lambda s, n: ours("pyrender", s, 1, shadows=False)),
            ("empty OpenGL frame", empty_gl),
            ("gym-aloha (MuJoCo)", lambda s, n: aloha(s, 1)),
        ]
    started = time.monotonic()
    make_renderer().render(*port_pose("zvezda_aft", 10.0), SUN)
    print(f"machine: {platform.machine()}, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f}")
    print(f"first frame of this process: {time.monotonic() - started:.1f} s wall")
    print(f"{'CPU ms a frame':28s}" + "".join(f"{f'{h} x {w}':>14s}{'ratio':>8s}" for h, w in SIZES))
    base: dict = {}
    for name, measure in rows:
        cells = []
        for size in SIZES:
            try:
                value = measure(size, 2 if quick else 5)
            except (ImportError, MissingDependencyError) as error:
                cells.append(f"{'-':>14s}{'':8s}")
                reason = str(error).split(".")[0]
                if size == SIZES[0]:
                    name = f"{name} ({reason})"[:60]
                continue
            base.setdefault(size, value)
            cells.append(f"{value:14.2f}{value / base[size]:8.2f}")
        print(f"{name:28s}" + "".join(cells), flush=True)
    print(
        "frames a second and core: "
        + ", ".join(f"{h} x {w}: {1e3 / base[h, w]:.0f} (target {TARGET_FPS[h, w]})" for h, w in SIZES)
    )


def rows(quick: bool = False) -> Iterator[Row]:
    """The benchmarks' table: a frame of the software renderer beside other renderers' at each size."""
    peers = (
        ("pyrender, shadow map", lambda size: ours("pyrender", size, 1)),
        ("an empty OpenGL frame", lambda size: empty_gl(size, 2)),
        ("gym-aloha (MuJoCo)", lambda size: aloha(size, 1)),
    )
    for size in SIZES[-1:] if quick else SIZES:
        name = f"frame, {size[0]} × {size[1]}, low detail, 4 samples"
        software = ours("software", size, 2 if quick else 7)
        step = env_step(size, 2 if quick else 7)
        yield Row(f"environment step with a {name}", step, "ms CPU", "the frame alone", software)
        for peer, measure in peers:
            try:
                yield Row(name, software, "ms CPU", peer, measure(size))
            except (ImportError, MissingDependencyError) as error:
                yield Row(name, software, "ms CPU", f"{peer}: {str(error).split('.')[0]}")


def startup() -> None:
    """First frame of a new process, with the caches as they are and with none."""
    run = lambda env: subprocess.run([sys.executable, "-c", FIRST_FRAME], env=env, check=True, capture_output=True)  # noqa: E731
    run(os.environ)
    print("first frame, warm:", run(os.environ).stdout.decode().strip())
    with tempfile.TemporaryDirectory() as empty:
        caches = dict.fromkeys(("SPACEDOCK_CACHE", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), empty)
        done = run({**os.environ, **caches})
    print("first frame, cold:", done.stdout.decode().strip(), "| said on screen:", done.stderr.decode().strip())


def kib(pid: int | str, field: str) -> int:
    """A line of a process's memory summary, KiB."""
    return int(re.search(rf"^{field}:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M).group(1))


def memory() -> None:
    """16 environments at 480 x 640, in this process and in 16 forkserver processes: memory after a step each."""
    before = kib("self", "Pss")
    envs = [gymnasium.make("SpaceDock-v0") for _ in range(ENVS)]
    for seed, env in enumerate(envs):
        env.reset(seed=seed)
        env.step(np.zeros(6, np.float32))
    print(f"{ENVS} envs, one process: {kib('self', 'Pss') / 1024:.0f} MiB ({before / 1024:.0f} MiB before the first)")
    for env in envs:
        env.close()
    vector = SpaceDockEnvConfig().create_envs(ENVS, use_async_envs=True)["spacedock"][0]
    vector.reset(seed=list(range(ENVS)))
    vector.step(np.zeros((ENVS, 6), np.float32))
    total = sum(kib(process.pid, "Pss") for process in vector.processes)
    private = max(kib(p.pid, "Private_Dirty") + kib(p.pid, "Private_Clean") for p in vector.processes)
    print(
        f"{ENVS} envs, {ENVS} processes: {total / 1024:.0f} MiB together, at most {private / 1024:.0f} MiB private each"
    )
    vector.close()


def main() -> int:
    """Run what the flags ask for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer repeats, software renderer only")
    parser.add_argument("--startup", action="store_true", help="time the first frame instead, warm and cold")
    parser.add_argument("--memory", action="store_true", help="measure the memory of 16 environments instead")
    flags = parser.parse_args()
    if flags.startup:
        startup()
    if flags.memory:
        memory()
    if not flags.startup and not flags.memory:
        table(flags.quick)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
