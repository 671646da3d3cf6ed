"""Arrays that take a second to make, kept between runs where the user's cache folder can be written."""

from __future__ import annotations

import hashlib
import os
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
        path = user_cache_dir() / f"{name}-{digest.hexdigest()[:16]}.npz"
        with np.load(path, allow_pickle=False) as stored:
            return {key: stored[key] for key in stored.files}
    except (OSError, ValueError, EOFError, KeyError, RuntimeError):
        pass  # also zipfile.BadZipFile's relatives, below
    except Exception as error:
        if type(error).__name__ != "BadZipFile":
            raise
    arrays = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, aside = tempfile.mkstemp(dir=path.parent, suffix=".npz")
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)
        os.replace(aside, path)  # whole or not at all, also with several processes at once
    except (OSError, RuntimeError):
        pass
    return arrays
