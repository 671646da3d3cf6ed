"""The same bytes in every process, thread and start method; golden pictures; nothing written into the package."""

import concurrent.futures
import hashlib
import multiprocessing
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import lerobot_spacedock
from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer
from lerobot_spacedock.camera.contact_sheet import ECLIPSE_SUN_H, port_pose

pytestmark = pytest.mark.render
GOLDEN = Path(__file__).parent / "golden"
SHOTS = {
    "zvezda_25m": ("zvezda_aft", 25.0, FIXED_SUN_H["zvezda_aft"]),
    "zvezda_3m": ("zvezda_aft", 3.0, FIXED_SUN_H["zvezda_aft"]),
    "zvezda_0.3m": ("zvezda_aft", 0.3, FIXED_SUN_H["zvezda_aft"]),
    "zvezda_3m_eclipse": ("zvezda_aft", 3.0, ECLIPSE_SUN_H),
    "harmony_10m": ("harmony_forward", 10.0, FIXED_SUN_H["harmony_forward"]),
    "harmony_1m": ("harmony_forward", 1.0, FIXED_SUN_H["harmony_forward"]),
}


def draw(name: str) -> np.ndarray:
    port, distance, sun = SHOTS[name]
    return make_renderer(CameraConfig(height=96, width=128, port=port)).render(*port_pose(port, distance), sun)


def digest(_=None) -> str:
    return hashlib.sha256(b"".join(draw(name).tobytes() for name in SHOTS)).hexdigest()


HERE = str(Path(__file__).parent)
PROGRAM = f"import sys; sys.path.insert(0, {HERE!r}); import test_frames_everywhere as t; print(t.digest())"


@pytest.mark.parametrize("name", SHOTS)
def test_golden_pictures(name):
    """A picture changed? If it was meant to, say why in golden/CHANGES.md and run this file as a program."""
    with Image.open(GOLDEN / f"{name}.png") as stored:
        golden = np.asarray(stored)
    drawn = draw(name)
    if platform.machine() == "x86_64":
        assert (drawn == golden).all(), f"{(drawn != golden).any(-1).sum()} pixels differ"
    else:
        assert np.abs(drawn.astype(int) - golden).mean() < 0.5


def test_threads_draw_the_same_bytes():
    here = digest()
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        assert set(pool.map(digest, range(4))) == {here}


@pytest.mark.parametrize("method", ["forkserver", "spawn", "fork"])
def test_start_methods(method):
    here = digest()
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method)) as pool:
        assert pool.submit(digest).result(timeout=300) == here


@pytest.mark.slow
@pytest.mark.parametrize("cpu", ["generic", "x86-64-v3"])
def test_other_cpu_targets_draw_the_same_bytes(cpu, tmp_path):
    if platform.machine() != "x86_64":
        pytest.skip("names of x86 targets")
    env = {**os.environ, "NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path)}
    if cpu == "x86-64-v3":
        env["NUMBA_CPU_FEATURES"] = "+avx2,+fma,+bmi,+bmi2,+f16c,+lzcnt,+movbe"
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=env, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == digest()


@pytest.mark.slow
def test_read_only_package_and_no_cache_at_all(tmp_path):
    """A copy of the package that nobody may write, no user cache: the frame is the same and nothing appears."""
    copy = tmp_path / "site" / "lerobot_spacedock"
    shutil.copytree(Path(lerobot_spacedock.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    before = sorted(p.relative_to(copy) for p in copy.rglob("*"))
    for path in [copy, *copy.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    nowhere = tmp_path / "file"
    nowhere.write_text("in the way of a folder")
    env = {**os.environ, "PYTHONPATH": str(copy.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    env |= {"SPACEDOCK_CACHE": str(nowhere), "XDG_CACHE_HOME": str(nowhere), "HOME": str(nowhere)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=env, capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout.split()[-1] == digest()
    assert sorted(p.relative_to(copy) for p in copy.rglob("*")) == before


def test_importing_the_camera_is_light():
    heavy = ("numba", "OpenGL", "trimesh", "cv2", "torch")
    code = f"import sys, lerobot_spacedock.camera; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs Linux's list of loaded libraries")
def test_no_graphics_library_is_loaded():
    """The whole process of drawing a frame maps no OpenGL, EGL, OSMesa, Vulkan or X11 library into memory."""
    code = PROGRAM + "; print(open('/proc/self/maps').read())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "llvmlite" in done.stdout
    found = [w for w in ("libGL", "libEGL", "libOSMesa", "libvulkan", "libX11", "libgallium") if w in done.stdout]
    assert not found


def test_renderers_share_one_scene():
    a = make_renderer(CameraConfig(height=96, width=128))
    b = make_renderer(CameraConfig(height=48, width=64))
    assert a._scene is b._scene
    assert a._scene.shadow_maps(FIXED_SUN_H["zvezda_aft"]) is b._scene.shadow_maps(FIXED_SUN_H["zvezda_aft"])


if __name__ == "__main__":
    for shot in SHOTS:
        Image.fromarray(draw(shot)).save(GOLDEN / f"{shot}.png", optimize=True)
        print("wrote", GOLDEN / f"{shot}.png")
