"""Faults of a real camera, applied after the film curve, before sRGB: lens, blur, bloom, noise.

So full well and bloom threshold are levels of the developed picture (1 is white), whatever the exposure: a simple model
of what a policy must bear, not of a detector.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.errors import InputError

from .config import CameraConfig
from .pinhole import intrinsics

MAX_PAD_SHARE = 0.6  # of the picture's side that may be drawn outside it, for the lens to bend in


def sensor_noise(config: CameraConfig, seed: int, time_s: float) -> np.random.Generator | None:
    """The source of one frame's noise: a function of the camera's seed, the episode's and the moment in it.

    Whoever draws a state again draws its noise again, also by the float32 time that a dataset keeps. None for a camera
    without noise.
    """
    if not config.sensor.noisy:
        return None
    return np.random.default_rng([config.sensor.seed, seed % 2**63, int(np.float32(time_s).view(np.uint32))])


class Sensor:
    """Applies one :class:`SensorConfig` to pictures of one size.

    Attributes:
        pad: pixels that must be drawn around the picture on each side, as (rows, columns).
    """

    def __init__(self, config: CameraConfig) -> None:
        self.config = config
        self._count = 0
        self.pad = (0, 0)
        self._source = None
        sensor = config.sensor
        if sensor.distortion_k1 or sensor.distortion_k2:
            self._source = _undistorted_places(config)
            column, row = self._source
            reach = (
                max(0.0, -row.min(), row.max() - (config.height - 1)),
                max(0.0, -column.min(), column.max() - (config.width - 1)),
            )
            self.pad = (math.ceil(reach[0]) + 1, math.ceil(reach[1]) + 1)
            if self.pad[0] > MAX_PAD_SHARE * config.height + 2 or self.pad[1] > MAX_PAD_SHARE * config.width + 2:
                given = (sensor.distortion_k1, sensor.distortion_k2)
                raise InputError("camera.sensor.distortion_k1, k2", given, "a distortion that bends the corners less")

    def expose(self, linear: np.ndarray, generator: np.random.Generator | None) -> np.ndarray:
        """(H + 2 pad, W + 2 pad, 3) float32, linear 0..1 → (H, W, 3) uint8."""
        from .kernels_shade import encode

        s = self.config.sensor
        if self._source is not None:
            linear = _sample(linear, self._source[0] + self.pad[1], self._source[1] + self.pad[0])
        if s.blur_px > 0.0:
            linear = _blur(linear, s.blur_px)
        if s.bloom > 0.0 and s.bloom_px > 0.0:
            linear = linear + np.float32(s.bloom) * _blur(
                np.maximum(linear - np.float32(s.bloom_threshold), 0), s.bloom_px
            )
        if s.noisy:
            if generator is None:  # each frame its own, in the order in which they are drawn
                generator = np.random.Generator(np.random.PCG64([s.seed, self._count]))
                self._count += 1
            variance = np.full_like(linear, s.read_noise**2)
            if s.full_well_electrons > 0.0:
                variance += np.maximum(linear, 0) / np.float32(s.full_well_electrons)  # Poisson, in its normal limit
            linear = linear + generator.standard_normal(linear.shape, dtype=np.float32) * np.sqrt(variance)
        out = np.empty(linear.shape, np.uint8)
        encode(np.ascontiguousarray(linear, np.float32).reshape(-1), linear.size, out.reshape(-1), 0)
        return out


def distort(config: CameraConfig, points: np.ndarray) -> np.ndarray:
    """Pinhole image points (N, 2) pixels → where the lens puts them (N, 2) pixels."""
    k, s = intrinsics(config), config.sensor
    x = (np.asarray(points, float) - k[:2, 2]) / k[0, 0]
    r2 = (x * x).sum(-1, keepdims=True)
    return x * (1.0 + s.distortion_k1 * r2 + s.distortion_k2 * r2 * r2) * k[0, 0] + k[:2, 2]


def _undistorted_places(config: CameraConfig) -> tuple[np.ndarray, np.ndarray]:
    """For each pixel of the bent picture, the column and row of the straight picture that it shows."""
    k, s = intrinsics(config), config.sensor
    u, v = np.meshgrid(np.arange(config.width) + 0.5, np.arange(config.height) + 0.5)
    x, y = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
    bent = np.sqrt(x * x + y * y)
    straight = bent.copy()
    for _ in range(30):  # Newton on r (1 + k1 r² + k2 r⁴) = bent
        r2 = straight * straight
        value = straight * (1.0 + s.distortion_k1 * r2 + s.distortion_k2 * r2 * r2) - bent
        slope = 1.0 + 3.0 * s.distortion_k1 * r2 + 5.0 * s.distortion_k2 * r2 * r2
        if slope.min() < 0.1:
            raise InputError(
                "camera.sensor.distortion_k1, k2",
                (s.distortion_k1, s.distortion_k2),
                "a distortion that grows with the angle all over the picture",
            )
        straight = straight - value / slope
    scale = np.where(bent > 1e-9, straight / np.maximum(bent, 1e-9), 1.0)
    return x * scale * k[0, 0] + k[0, 2] - 0.5, y * scale * k[1, 1] + k[1, 2] - 0.5


def _sample(image: np.ndarray, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Bilinear look-up, clamped at the edge."""
    column = np.clip(column, 0, image.shape[1] - 1.001)
    row = np.clip(row, 0, image.shape[0] - 1.001)
    j, i = column.astype(np.int64), row.astype(np.int64)
    fu = (column - j).astype(np.float32)[..., None]
    fv = (row - i).astype(np.float32)[..., None]
    top = image[i, j] * (1 - fu) + image[i, j + 1] * fu
    low = image[i + 1, j] * (1 - fu) + image[i + 1, j + 1] * fu
    return top * (1 - fv) + low * fv


def _blur(image: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian blur, the edge repeated."""
    radius = max(1, math.ceil(3.0 * sigma))
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    weights = np.round(weights / weights.sum(), 7).astype(np.float32)
    for axis in (0, 1):
        pad = [(radius, radius) if a == axis else (0, 0) for a in range(3)]
        wide = np.pad(image, pad, mode="edge")
        out = np.zeros_like(image)
        for k, w in enumerate(weights):
            window = wide[k : k + image.shape[0]] if axis == 0 else wide[:, k : k + image.shape[1]]
            out += w * window
        image = out
    return image
