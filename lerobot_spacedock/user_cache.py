"""Where this package keeps what it can make again: compiled kernels, meshes, textures."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache_dir() -> Path:
    """``$SPACEDOCK_CACHE``, or ``lerobot_spacedock`` in the user's cache folder; not made here.

    Raises:
        RuntimeError: the user has no home folder, and neither variable is set.
    """
    if os.environ.get("SPACEDOCK_CACHE"):
        return Path(os.environ["SPACEDOCK_CACHE"])
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lerobot_spacedock"
