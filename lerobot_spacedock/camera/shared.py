"""What renderers of one process share: scenes, patterns, Earth and stars, each made once."""

from __future__ import annotations

import contextlib
import functools
import gc
import sys
import threading
from pathlib import Path

import numpy as np

from lerobot_spacedock.station import load_station, materials, station_for_port
from lerobot_spacedock.station.cache import cached_arrays
from lerobot_spacedock.station.mesh import checked_transform

from .scene import Scene, make_scene, sun_key
from .sun import FIXED_SUN_H

_lock = threading.RLock()
_scenes: dict[tuple, Scene] = {}
_begun: set[str] = set()
NOTICE_AFTER_s = 3.0


def shared_scene(port: str, detail: str, station_mesh=None, station_pose=None) -> Scene:
    """The scene for a port, a level of detail and perhaps a user's mesh."""
    if station_mesh is None:
        key: tuple = (port, detail)
    else:
        path = Path(station_mesh).expanduser().resolve()
        stamp = path.stat().st_mtime_ns if path.exists() else 0
        pose = None if station_pose is None else checked_transform(station_pose).tobytes()
        key = (str(path), stamp, pose)
    with _lock:
        if key not in _scenes:
            if station_mesh is None:
                scene = make_scene(functools.partial(station_for_port, port, detail), f"scene-{port}-{detail}")
                scene.kept_suns[sun_key(FIXED_SUN_H[port])] = f"shadows-{port}-{detail}"
            else:
                mesh = load_station(station_mesh, station_pose)
                scene = make_scene(lambda: mesh)
            _scenes[key] = scene
        return _scenes[key]


@functools.lru_cache(maxsize=1)
def pattern_texels() -> np.ndarray:
    """All surface patterns with their mip levels, flat uint32."""
    from . import patterns

    stored = cached_arrays(
        "patterns", (patterns.__file__, materials.__file__), lambda: {"texels": patterns.make_patterns()}
    )
    return stored["texels"]


@functools.lru_cache(maxsize=1)
def earth_texels() -> np.ndarray:
    """The Earth patch below the station, flat uint32."""
    from .earth import make_earth

    return make_earth()


@functools.lru_cache(maxsize=1)
def star_table() -> np.ndarray:
    """(S, 6) float64: direction in Hill axes and brightness in red, green, blue."""
    from .earth import make_stars

    return make_stars()


@contextlib.contextmanager
def compiling_notice(stage: str):
    """Say on standard error that kernels are being compiled, if the first use of a stage takes more than a moment.

    Rests the garbage collector meanwhile: a compiler makes many objects, and it would go through them again and again.
    """
    if stage in _begun:
        yield
        return
    _begun.add(stage)
    text = "spacedock: loading the renderer; the first time on a machine it is compiled, about half a minute ..."
    notice = threading.Timer(NOTICE_AFTER_s, print, (text,), {"file": sys.stderr, "flush": True})
    notice.daemon = True
    notice.start()
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        notice.cancel()
        if collects:
            gc.enable()
