"""The default renderer: a rasteriser in Numba that needs no GPU, no display and no GL library."""

from __future__ import annotations

import threading

import numpy as np

from lerobot_spacedock.errors import SimulationError

from . import warm
from .config import CameraConfig
from .exposure import light_array
from .kernels_resolve import CASCADE_SIZE
from .kernels_simd import CELL, TILE_CELLS, tiles_of
from .pinhole import checked_pose, checked_sun, intrinsics, rotation_CH
from .renderer import Buffers
from .sensor import Sensor
from .shadow_maps import ShadowMaps
from .shared import compiling_notice, earth_texels, pattern_texels, shared_scene, star_table

FINEST_PIXELS = 0.05  # parts that look narrower are left out of the picture (never out of depth and segments)
_work = threading.local()


class SoftwareRenderer:
    """Draws views of the station. Safe to use from several threads, and after fork or spawn."""

    def __init__(self, config: CameraConfig, station_mesh=None, station_pose=None) -> None:
        self.config = config
        warm.begin()
        with compiling_notice("scene"):
            self._scene = shared_scene(config.port, config.detail, station_mesh, station_pose)
        k = intrinsics(config)
        self._view = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], config.near_m])
        self._sensor = Sensor(config) if config.sensor.active else None
        self._pad = self._sensor.pad if self._sensor else (0, 0)
        self._wide_view = self._view + np.array([0.0, 0.0, self._pad[1], self._pad[0], 0.0])

    def render(self, r_H, q_HB, sun_H, *, generator=None) -> np.ndarray:
        """See :class:`lerobot_spacedock.camera.Renderer`."""
        r, q = checked_pose(r_H, q_HB)
        with compiling_notice("frame"):
            warm.finish()
            return self._image(r, rotation_CH(q), checked_sun(sun_H), generator)

    def render_buffers(self, r_H, q_HB, sun_H, *, generator=None) -> Buffers:
        """See :class:`lerobot_spacedock.camera.Renderer`."""
        from .frame import read_geometry

        r, q = checked_pose(r_H, q_HB)
        rot = rotation_CH(q)
        with compiling_notice("frame"):
            warm.finish()
            image = self._image(r, rot, checked_sun(sun_H), generator)
        scene, config = self._scene, self.config
        width, height = config.width, config.height
        cells, _ = _draw_samples(scene, rot, r, self._view, width, height, 1, 0.0)
        return Buffers(image, *read_geometry(cells, scene.segment, width, height, np.float32(config.far_m)))

    def close(self) -> None:
        """Let go of the scene (other renderers may go on sharing it)."""
        self._scene = None

    def _image(self, r, rot, sun, generator) -> np.ndarray:
        from .frame import paint_frame

        if self._scene is None:
            raise SimulationError("this renderer is closed; make another with make_renderer()")
        scene, config = self._scene, self.config
        light, star_gain = light_array(config, r, sun)
        # the darkness of eclipse needs no maps: any that exist will do
        maps = scene.shadow_maps(sun) if config.shadows and light[3] > 0.0 else _NO_MAPS
        height, width = config.height + 2 * self._pad[0], config.width + 2 * self._pad[1]
        linear = np.empty((height, width, 3) if self._sensor else (0, 0, 3), np.float32)
        image = np.empty((config.height, config.width, 3), np.uint8)
        samples = _draw_samples(scene, rot, r, self._wide_view, width, height, config.samples, FINEST_PIXELS)
        paint_frame(
            *samples, scene.table, scene.materials, pattern_texels(), maps.maps, maps.cascades, maps.axes,
            earth_texels(), star_table(), star_gain, light, rot, r, self._wide_view, width, height, config.samples,
            linear.reshape(-1), image.reshape(-1),
        )  # fmt: skip
        return self._sensor.expose(linear, generator) if self._sensor else image


# one map about the port that nothing can be outside of, and no texels
_NO_MAPS = ShadowMaps(np.zeros(0, np.uint16), np.zeros((3, CASCADE_SIZE), np.float32), np.zeros((3, 3), np.float32))


def _draw_samples(scene, rot, eye, view, width, height, samples, finest) -> tuple[np.ndarray, np.ndarray]:
    """What each sample shows, and how far behind the camera each shown surface's plane is (``draw_triangles``)."""
    from .kernels_raster import draw_triangles

    cells, away, floors = _scratch(len(scene.table), width, height, samples)
    draw_triangles(
        scene.corners, scene.faces, scene.surface, scene.clusters, scene.spheres, scene.cones, rot, eye, view,
        width, height, samples, finest, cells, away, floors,
    )  # fmt: skip
    return cells, away


def _scratch(surfaces: int, width: int, height: int, samples: int) -> tuple[np.ndarray, ...]:
    """Room for samples, surfaces and tiles: one a thread, shared by its renderers."""
    tiles = tiles_of(width, height, samples)
    wanted = (tiles * TILE_CELLS * CELL, surfaces, tiles)
    room = getattr(_work, "room", None)
    if room is None or any(len(a) < n for a, n in zip(room, wanted, strict=True)):
        have = (0, 0, 0) if room is None else tuple(len(a) for a in room)
        sizes = [max(pair) for pair in zip(have, wanted, strict=True)]
        room = tuple(np.empty(n, kind) for n, kind in zip(sizes, (np.int32, np.float32, np.float32), strict=True))
        _work.room = room
    return room
