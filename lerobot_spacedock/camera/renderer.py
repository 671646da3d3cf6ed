"""The small interface behind which every backend sits."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from lerobot_spacedock.errors import InputError, one_of

from .config import BACKENDS, CameraConfig


class Buffers(NamedTuple):
    """One view: colours, depth and what each pixel shows."""

    image: np.ndarray
    """(H, W, 3) uint8, sRGB."""
    depth_m: np.ndarray
    """(H, W) float32, distance along the view axis at each pixel's centre; ``far_m`` for the sky."""
    segmentation: np.ndarray
    """(H, W) uint8, index into ``lerobot_spacedock.station.SEGMENTS`` at each pixel's centre; 0 is the sky."""


class Renderer(Protocol):
    """Draws one view at a time; renderers in one process share scene, shadow maps and sky."""

    config: CameraConfig

    def render(self, r_H, q_HB, sun_H, *, generator: np.random.Generator | None = None) -> np.ndarray:
        """(H, W, 3) uint8 picture.

        Args:
            r_H: m, (3,), camera in Hill axes, relative to the docking port.
            q_HB: attitude, (4,), scalar first, body to Hill.
            sun_H: direction to the Sun, (3,), Hill axes.
            generator: source of the sensor noise; the configured seed where left out.
        """

    def render_buffers(self, r_H, q_HB, sun_H, *, generator: np.random.Generator | None = None) -> Buffers:
        """The picture with depth and segmentation."""

    def close(self) -> None:
        """Give back what the renderer holds; may be called twice."""


def make_renderer(
    config: CameraConfig | None = None,
    backend: str = "software",
    station_mesh: str | Path | None = None,
    station_pose: np.ndarray | None = None,
) -> Renderer:
    """A renderer.

    Args:
        config: the camera; the default is 480 x 640 with a vertical field of view of 60 degrees.
        backend: software (Numba, needs nothing but pip packages) or pyrender (OpenGL through EGL or OSMesa).
        station_mesh: a mesh file (glb, gltf, obj, stl, ply) to draw in place of the built-in station.
        station_pose: (4, 4) transform of that mesh's coordinates (m) into Hill axes at the port; identity by default.

    Raises:
        InputError: an unknown backend or a bad option.
        FileFormatError: a mesh file that cannot be read.
        MissingDependencyError: the pyrender backend without its packages or without OpenGL libraries.
    """
    config = CameraConfig() if config is None else config
    one_of("renderer", backend, BACKENDS)
    if station_pose is not None and station_mesh is None:
        raise InputError("station_pose", station_pose, "nothing without station_mesh, whose pose it is")
    if backend == "software":
        from .software import SoftwareRenderer

        return SoftwareRenderer(config, station_mesh, station_pose)
    from .pyrender_backend import PyrenderRenderer

    return PyrenderRenderer(config, station_mesh, station_pose)
