"""The first use on a machine: what helper processes make is what the frame needs, and nothing hangs on them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import test_frames_everywhere as everywhere

from lerobot_spacedock.camera import CameraConfig, kernels_resolve, make_renderer, warm

pytestmark = pytest.mark.render
COLD = """
import os, sys
os.sched_getaffinity = lambda _: range({cpus})
sys.path.insert(0, {here!r})
import test_frames_everywhere as t
from lerobot_spacedock.camera import make_renderer, warm
renderer = make_renderer()
print(len(warm._helpers))
if {killed}:
    [helper.kill() for helper, _ in warm._helpers]
print(t.digest())
assert not warm._helpers
"""


@pytest.fixture
def alone(monkeypatch):
    """As in a process that has not begun, whose helpers are recorded and not started."""
    started = []
    monkeypatch.setattr(warm, "_begun_in", 0)
    monkeypatch.setattr(warm, "_helpers", [])
    monkeypatch.setattr(warm, "_first", lambda: True)
    monkeypatch.setattr(warm, "_compiled", lambda job: False)
    monkeypatch.setattr(warm.atexit, "register", lambda function: None)
    monkeypatch.setattr(warm.subprocess, "Popen", lambda command, **_: started.append(command[3:]))
    return started


@pytest.mark.parametrize("cpus", [1, 2, 3, 4, 64])
def test_helpers_by_number_of_cpus(cpus, alone, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(cpus), raising=False)
    warm.begin()
    warm.begin()
    assert len(alone) == {1: 0, 2: 1, 3: 1}.get(cpus, 3)
    jobs = [job for share in alone for job in share]
    assert len(set(jobs)) == len(jobs)
    assert set(jobs) <= {*warm.KERNELS, "earth"} - {"frame"}


@pytest.mark.parametrize("reason", ["warm", "another process", "frozen"])
def test_no_helpers_where_they_would_be_of_no_use(reason, alone, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(4), raising=False)
    if reason == "warm":
        monkeypatch.setattr(warm, "_compiled", lambda job: job == "frame")
    if reason == "another process":
        monkeypatch.setattr(warm, "_first", lambda: False)
    if reason == "frozen":
        monkeypatch.setattr(sys, "frozen", True, raising=False)
    warm.begin()
    assert not alone
    assert not warm._helpers


def test_what_is_compiled_has_no_helpers():
    make_renderer(CameraConfig(height=96, width=128)).render((0, -3, 0), (0.5**0.5, -(0.5**0.5), 0, 0), (0, 0, 1))
    assert warm._compiled("frame")
    assert not warm._helpers


@pytest.mark.parametrize("program", ["raise SystemExit(1)", "import time; time.sleep(60)"])
def test_helpers_that_fail_or_hang_are_let_go(program, monkeypatch):
    done = []
    helper = subprocess.Popen([sys.executable, "-c", program])
    monkeypatch.setattr(warm, "GIVE_UP_s", 0.5)
    monkeypatch.setattr(warm, "do", done.append)
    monkeypatch.setattr(warm, "_begun_in", os.getpid())
    monkeypatch.setattr(warm, "_compiled", lambda job: False)
    monkeypatch.setattr(warm, "_helpers", [(helper, ("raster", "shade", "earth"))])
    warm.finish()
    assert done == ["sky", "stars", "frame"]
    assert helper.returncode is not None
    assert not warm._helpers


def test_a_forked_child_leaves_its_parents_helpers_alone(monkeypatch):
    monkeypatch.setattr(warm, "_begun_in", os.getpid() + 1)
    monkeypatch.setattr(warm, "_helpers", [("not mine", ("raster",))])
    warm.finish()
    assert warm._helpers == [("not mine", ("raster",))]


def test_a_kernel_for_kernels_says_so():
    """Numba itself would end the process with a segmentation fault."""
    with pytest.raises(TypeError, match="gather"):
        kernels_resolve.gather(0, 0, None, None, None, None, None, None)


@pytest.mark.slow
@pytest.mark.parametrize(("cpus", "killed"), [(2, False), (4, False), (4, True)])
def test_the_first_frame_with_helpers(cpus, killed, tmp_path):
    """The same bytes; and each kernel compiled once, so that what helpers compile is what the frame calls."""
    env = {**os.environ, "SPACEDOCK_CACHE": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    env.pop("NUMBA_CACHE_DIR", None)
    program = COLD.format(cpus=cpus, killed=killed, here=str(Path(everywhere.__file__).parent))
    done = subprocess.run([sys.executable, "-c", program], env=env, capture_output=True, text=True, check=True)
    helpers, digest = done.stdout.split()
    assert int(helpers) == {2: 1, 4: 3}[cpus]
    assert digest == everywhere.digest()
    for kernels in warm.KERNELS.values():
        for name in kernels:
            assert len(list(tmp_path.rglob(f"{name}-*.nbc"))) == 1, name
