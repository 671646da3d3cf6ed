"""Poses, a Sun and a camera model in; pictures out. Nothing heavy loads until a renderer is made."""

from .config import BACKENDS, DETAILS, PORTS, CameraConfig, SensorConfig
from .pinhole import extrinsics, intrinsics, project_points
from .renderer import Buffers, Renderer, make_renderer
from .sensor import sensor_noise
from .sun import FIXED_SUN_H, draw_sun, sun_from_orbit, sunlit_share

__all__ = [
    "BACKENDS",
    "DETAILS",
    "FIXED_SUN_H",
    "PORTS",
    "Buffers",
    "CameraConfig",
    "Renderer",
    "SensorConfig",
    "draw_sun",
    "extrinsics",
    "intrinsics",
    "make_renderer",
    "project_points",
    "sensor_noise",
    "sun_from_orbit",
    "sunlit_share",
]
