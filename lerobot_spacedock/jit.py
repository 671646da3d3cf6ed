"""Numba's ``njit`` with a disk cache that knows the whole package.

Numba notices that a function's own file has changed, but not that a function it calls from another file has: an edit of
``env/reward.py`` would go on running the old reward from the cache. So the cache stands in a folder named after a hash
of all sources that the kernels of a room can call. The folder is the user's, not the package's, which may be read-only;
``NUMBA_CACHE_DIR`` overrides it.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.registry import CPUDispatcher

from lerobot_spacedock.user_cache import user_cache_dir

_ROOT = Path(__file__).parent
# room of a kernel → rooms whose kernels and constants it may use
_SOURCES = {"physics": ("physics",), "env": ("physics", "env"), "camera": ("physics", "camera")}
_COMPILED = (b"spacedock.jit import", b"numba.extending import")  # what a file of kernels imports
_KEEP_UNUSED_s = 30 * 24 * 3600


def jit(function: Callable | None = None, **options: Any) -> Callable:
    """``numba.njit(cache=True, …)`` with this package's cache folder; used with or without arguments.

    Division by zero gives inf or NaN as in NumPy, instead of a test and a branch at every division; callers check
    that what comes out is finite.
    """
    if function is None:
        return functools.partial(jit, **options)
    saved = numba.config.CACHE_DIR
    try:
        numba.config.CACHE_DIR = saved or str(cache_dir(function.__module__.split(".")[1]))
        return numba.njit(cache=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = saved


class _Inner(CPUDispatcher):
    """What has no entry from Python says so; Numba itself would jump to nowhere."""

    def __call__(self, *_, **__):
        raise TypeError(f"{self.py_func.__qualname__} can be called by compiled functions only: see jit.inner")


def inner(function: Callable | None = None, *, allocates: bool = False, **options: Any) -> Callable:
    """:func:`jit` for what only other compiled functions call.

    Around each function Numba compiles two more, for calls from Python and from C, and counts references to each array
    that it touches. A function that is spared both takes 10 to 20 % less time to compile.

    Args:
        function: what to compile.
        allocates: it makes arrays, so their references must be counted.
        **options: as of :func:`jit`.
    """
    if function is None:
        return functools.partial(inner, allocates=allocates, **options)
    compiled = jit(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=allocates, **options)
    if isinstance(compiled, CPUDispatcher):  # not where NUMBA_DISABLE_JIT is set
        compiled.__class__ = _Inner
    return compiled


@functools.cache
def cache_dir(room: str) -> Path:
    """The folder of a room's compiled kernels for exactly these sources; a temporary one if it cannot be made."""
    digest = hashlib.sha256(Path(__file__).read_bytes())  # its options are every kernel's
    for source_room in _SOURCES[room]:
        for path in sorted((_ROOT / source_room).rglob("*.py")):
            content = path.read_bytes()
            if source_room == "physics" or any(word in content for word in _COMPILED):
                digest.update(path.name.encode() + content)
    name = f"{room}-{digest.hexdigest()[:16]}"
    for find_base in (lambda: user_cache_dir() / "kernels", _temporary_dir):
        try:
            base = find_base()
            folder = base / name
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
        except (OSError, RuntimeError):
            continue
        _remove_unused(base)
        return folder
    return Path(tempfile.mkdtemp(prefix="lerobot_spacedock-"))


def _temporary_dir() -> Path:
    return Path(tempfile.gettempdir()) / f"lerobot_spacedock-{os.getuid()}"


def _remove_unused(base: Path) -> None:
    oldest = time.time() - _KEEP_UNUSED_s
    for folder in base.iterdir():
        try:
            if folder.is_dir() and folder.stat().st_mtime < oldest:
                shutil.rmtree(folder, ignore_errors=True)
        except OSError:
            continue
