"""The first use on a machine, on several CPUs: helper processes make a part of what the caches lack.

Numba compiles one function at a time, mostly in Python. What helpers compile and make reaches this process through the
caches on disk; what they do not, because one died or was never started, this process makes itself.
``python -m lerobot_spacedock.camera.warm JOB...`` is a helper.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import subprocess
import sys
import threading
import time
from multiprocessing.spawn import get_executable
from pathlib import Path

import numba
from numba.core.sigutils import normalize_signature

from lerobot_spacedock.invocation import available_cores
from lerobot_spacedock.jit import cache_dir

from .shared import earth_texels, pattern_texels

GIVE_UP_s = 120.0  # a helper that has not ended so long after this process ran out of work is stopped
_F1, _F2, _D1, _D2, _I1 = "f4[::1]", "f4[:,::1]", "f8[::1]", "f8[:,::1]", "i4[::1]"
# What Python or ``paint_frame`` calls, with the types of the arguments (a wrong one would waste time, no more).
# "frame" comes last: what it calls must be there.
KERNELS = {
    "raster": {
        "kernels_raster.draw_triangles": f"{_F2},{_F2},{_I1},i4[:,::1],{_F2},{_F2},{_D2},{_D1},{_D1},i8,i8,i8,f8,"
        f"{_I1},{_F1},{_F1}",
    },
    "sky": {
        "kernels_sky.paint_sky": f"i8,i8,i8,{_F1},{_D2},{_D1},{_F1},{_I1},{_F1}",
    },
    "stars": {
        "kernels_sky.project_stars": f"{_D2},{_D2},{_D1},i8,i8,{_D2}",
        "kernels_sky.paint_stars": f"{_D2},i8,i8,i8,i8,{_F1},f4,{_F1}",
    },
    "shade": {
        "kernels_resolve.collect": f"{_I1},i8,i8,i8,UniTuple(f8,4),i8,i8,{_I1},{_I1},{_F1},{_F1},{_F1},{_F1}",
        "kernels_resolve.gather": f"i8,i8,{_I1},{_F1},{_F2},{_F2},{_F1},{_I1}",
        "kernels_resolve.locate": f"i8,i8,{_F1},{_F1},{_F2},{_F2},{_D2},{_D1},{_D1},{_F1}",
        "kernels_shade.shade_shadow": f"i8,{_F1},u2[::1],{_F1},{_I1}",
        "kernels_shade.clothe": f"i8,{_I1},{_F1},{_I1}",
        "kernels_shade.lighten": f"i8,{_F1},{_F1}",
        "kernels_shade.deposit": f"i8,i8,{_I1},{_F1},{_F1},{_F1}",
        "kernels_shade.encode": f"{_F1},i8,u1[::1],i8",
    },
    "frame": {
        "frame.paint_frame": f"{_I1},{_F1},{_F2},{_F2},{_I1},u2[::1],{_F2},{_F2},{_I1},{_D2},f4,{_F1},{_D2},{_D1},"
        f"{_D1},i8,i8,i8,{_F1},u1[::1]",
    },
}
# What helpers do, by the number of CPUs; the scene and the rest are made in this process meanwhile.
SHARES = {2: (("sky", "raster", "earth"),), 4: (("sky", "stars", "earth"), ("raster",), ("shade",))}

_lock = threading.Lock()
_helpers: list[tuple[subprocess.Popen, tuple[str, ...]]] = []
_begun_in = 0  # process


def do(job: str) -> None:
    """Compile one group of kernels, or paint the Earth."""
    if job == "earth":
        earth_texels()
        return
    for name, types in KERNELS[job].items():
        module, kernel = name.split(".")
        arguments, _ = normalize_signature(f"({types})")  # the cache does not know the text
        getattr(importlib.import_module(f"{__package__}.{module}"), kernel).compile(arguments)


def begin() -> None:
    """Start helpers if nothing is compiled yet, there is more than one CPU, and no other process has helpers."""
    global _begun_in
    if _begun_in:
        return
    with _lock:
        if _begun_in:
            return
        _begun_in = os.getpid()
        cpus = available_cores()
        if cpus < min(SHARES) or numba.config.DISABLE_JIT or getattr(sys, "frozen", False) or not get_executable():
            return
        if _compiled("frame") or not _first():
            return
        package = str(Path(__file__).parents[2])
        env = {**os.environ, "NUMBA_CACHE_DIR": str(_folder())}
        env["PYTHONPATH"] = os.pathsep.join(p for p in (package, os.environ.get("PYTHONPATH")) if p)
        silent = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        atexit.register(_stop)
        for share in SHARES[max(n for n in SHARES if n <= cpus)]:
            command = [get_executable(), "-m", f"{__package__}.warm", *share]
            try:
                _helpers.append((subprocess.Popen(command, env=env, **silent), share))
            except OSError:
                continue


def finish() -> None:
    """Compile what the helpers leave to this process, then wait for them. Does nothing where there are none."""
    if not _helpers or os.getpid() != _begun_in:  # a forked child has no part in its parent's helpers
        return
    with _lock:
        given = {job: helper for helper, share in _helpers for job in share}
        for job in KERNELS:
            if job == "frame":
                for called in given.keys() & KERNELS.keys() - {"raster"}:
                    _wait(given[called], called)
            if job not in given:
                do(job)
        pattern_texels()
        for helper, _ in _helpers:
            _wait(helper)
        _stop()


def _wait(helper: subprocess.Popen, job: str | None = None) -> None:
    """Wait until a helper has ended, or has done a job."""
    until = time.monotonic() + GIVE_UP_s
    while helper.poll() is None and not (job and _compiled(job)) and time.monotonic() < until:
        time.sleep(0.02)


def _stop() -> None:
    """Let go of the helpers; those that have not ended are stopped."""
    while _helpers and os.getpid() == _begun_in:
        helper, _ = _helpers.pop()
        helper.kill()
        helper.wait()


def _folder() -> Path:
    return Path(numba.config.CACHE_DIR or cache_dir("camera"))


def _compiled(job: str) -> bool:
    """Whether the cache has the last kernel of a job, for some CPU."""
    return any(_folder().glob(f"*/{list(KERNELS[job])[-1]}-*.nbc"))


def _first() -> bool:
    """Whether no other process has helpers at work for this cache."""
    try:
        import fcntl

        _folder().mkdir(parents=True, exist_ok=True)
        lock = os.open(_folder() / "helpers.lock", os.O_CREAT | os.O_RDWR, 0o644)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until this process ends
    except (ImportError, OSError):
        return False
    return True


if __name__ == "__main__":
    gc.disable()
    for name in sys.argv[1:]:
        do(name)
