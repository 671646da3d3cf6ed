"""Arrays that take a second to make, kept between runs where the user's cache folder can be written.

They are mapped into memory: processes of one machine that read the same arrays share their pages.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lerobot_spacedock.user_cache import user_cache_dir


def cached_arrays(name: str, source: str | tuple[str, ...], make: Callable[[], dict]) -> dict[str, np.ndarray]:
    """Arrays from the cache, or from ``make``; keyed by the text of the source files that define them.

    A cache that cannot be read or written is passed over in silence: the arrays are then made anew.
    """
    digest = hashlib.sha256()
    for path in (source,) if isinstance(source, str) else source:
        digest.update(Path(path).read_bytes())
    try:
        folder = user_cache_dir() / f"{name}-{digest.hexdigest()[:16]}"
    except RuntimeError:  # no home
        return make()
    stored = _read(folder)
    if stored:
        return stored
    arrays = make()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{name}-"))
        try:
            for key, values in arrays.items():
                np.save(aside / f"{key}.npy", values, allow_pickle=False)
            _put(aside, folder)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    except OSError:
        return arrays
    return _read(folder) or arrays


def _put(aside: Path, folder: Path) -> None:
    """Renames: whole or not at all. Where another process was faster its folder stays; a damaged one is replaced."""
    try:
        os.rename(aside, folder)
    except OSError:
        if _read(folder):
            return
        shutil.rmtree(folder, ignore_errors=True)
        os.rename(aside, folder)


def _read(folder: Path) -> dict[str, np.ndarray]:
    """The arrays of a folder; none if it is not there or cannot be read. Writing into one changes no file."""
    try:
        return {path.stem: np.asarray(np.load(path, mmap_mode="c")).view(np.ndarray) for path in folder.glob("*.npy")}
    except (OSError, ValueError, EOFError):
        return {}
