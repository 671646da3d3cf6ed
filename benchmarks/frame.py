"""CPU time of one camera frame, beside pyrender, an empty OpenGL frame and gym-aloha, in one run.

python benchmarks/frame.py [--quick]

CPU time (all threads of the process) is reported, because it says what a frame costs on a busy machine too; the
median over repeats of the mean over 10 poses from 25 m to 0.2 m. On an idle machine the software renderer's wall time
equals its CPU time.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time

import numpy as np

from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer
from lerobot_spacedock.camera.contact_sheet import port_pose
from lerobot_spacedock.errors import MissingDependencyError

DISTANCES_m = (25.0, 20.0, 15.0, 10.0, 7.0, 4.0, 2.0, 1.0, 0.5, 0.2)
SIZES = ((480, 640), (240, 320), (96, 128))
TARGET_FPS = {(480, 640): 60, (240, 320): 180, (96, 128): 500}
SUN = FIXED_SUN_H["zvezda_aft"]


def cpu_ms(draw, repeats: int) -> float:
    """Median over repeats of the mean CPU time of ``draw(pose)`` over all poses, ms."""
    poses = [port_pose("zvezda_aft", d) for d in DISTANCES_m]
    for pose in poses[:2]:
        draw(pose)
    times = []
    for _ in range(repeats):
        start = time.process_time()
        for pose in poses:
            draw(pose)
        times.append((time.process_time() - start) / len(poses) * 1e3)
    return statistics.median(times)


def ours(backend: str, size, repeats: int, **options) -> float:
    """CPU time of a frame of one of the package's renderers, ms."""
    renderer = make_renderer(CameraConfig(height=size[0], width=size[1], **options), backend=backend)
    return cpu_ms(lambda pose: renderer.render(*pose, SUN), repeats)


def empty_gl(size, repeats: int) -> float:
    """CPU time of clearing an OpenGL frame and reading it back through pyrender, ms: the floor of any such back end."""
    import pyrender

    from lerobot_spacedock.camera import pyrender_backend as gl

    stage = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
    stage.main_camera_node = stage.add(pyrender.PerspectiveCamera(yfov=1.0))
    return cpu_ms(lambda _: gl._on_gl_thread(lambda: gl._offscreen(size[1], size[0]).render(stage)), repeats)


def aloha(size, repeats: int) -> float:
    """CPU time of a frame of gym-aloha's camera, ms."""
    import gym_aloha  # noqa: F401
    import gymnasium

    env = gymnasium.make("gym_aloha/AlohaInsertion-v0", obs_type="pixels")
    env.reset(seed=0)
    physics = env.unwrapped._env.physics
    return cpu_ms(lambda _: physics.render(height=size[0], width=size[1], camera_id="top"), repeats)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer repeats, software renderer only")
    quick = parser.parse_args().quick
    rows = [
        ("software, low, 4 samples", lambda s, n: ours("software", s, n)),
        ("software, low, 1 sample", lambda s, n: ours("software", s, n, samples=1)),
        ("software, high, 4 samples", lambda s, n: ours("software", s, n, detail="high")),
    ]
    if not quick:
        rows += [
            ("pyrender, shadow map", lambda s, n: ours("pyrender", s, max(1, n // 6))),
            ("pyrender, no shadow", lambda s, n: ours("pyrender", s, max(1, n // 6), shadows=False)),
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
                value = measure(size, 2 if quick else 7)
            except (ImportError, MissingDependencyError) as error:
                cells.append(f"{'-':>14s}{'':8s}")
                reason = str(error).split(".")[0]
                if size == SIZES[0]:
                    name = f"{name} ({reason})"[:60]
                continue
            base.setdefault(size, value)
            cells.append(f"{value:14.2f}{value / base[size]:8.2f}")
        print(f"{name:28s}" + "".join(cells))
    print(
        "frames a second and core: "
        + ", ".join(f"{h} x {w}: {1e3 / base[h, w]:.0f} (target {TARGET_FPS[h, w]})" for h, w in SIZES)
    )
    reference = np.random.default_rng(0).random(2_000_000, dtype=np.float32)
    times = []
    for _ in range(9):
        start = time.process_time()
        np.sqrt(reference)
        times.append((time.process_time() - start) * 1e3)
    print(f"reference: square roots of 2 million float32 in NumPy take {statistics.median(times):.2f} ms here")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
