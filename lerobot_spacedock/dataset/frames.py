"""Draws the frames of an episode: the camera at every state of a log, under that episode's Sun."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np

from lerobot_spacedock.camera import CameraConfig, Renderer, SensorConfig, make_renderer, sensor_noise
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.sunlight import SunPath
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.physics.frames import POSITION, QUATERNION


class Artist:
    """A renderer that knows what an episode log is; it draws what the environment of that episode would show.

    The renderer is made when the first picture is drawn, which may be never.

    Args:
        camera: keyword arguments of ``CameraConfig``; ``sensor`` those of ``SensorConfig``.
        renderer: as ``make_renderer``'s backend.
        station_mesh: file to draw in place of the built-in station.
        station_pose: 16 numbers, its pose.
        sun: as ``--env.sun``; drawn per episode from the log's seed (0 where it has none).
    """

    def __init__(
        self,
        camera: dict[str, Any] | None = None,
        renderer: str = "software",
        station_mesh: str | None = None,
        station_pose: list[float] | None = None,
        sun: str = "fixed",
    ) -> None:
        camera = dict(camera or {})
        camera["sensor"] = SensorConfig(**camera.get("sensor", {}))
        self.config = CameraConfig(**camera)
        self.sun = sun
        self._backend, self._mesh = renderer, station_mesh
        self._pose = None if station_pose is None else np.reshape(station_pose, (4, 4))

    @cached_property
    def renderer(self) -> Renderer:
        """Made at the first use.

        Raises:
            InputError, FileFormatError, MissingDependencyError: as ``make_renderer``.
        """
        return make_renderer(self.config, self._backend, self._mesh, self._pose)

    def draw(self, log: EpisodeLog, first: int = 0, last: int | None = None) -> Iterator[np.ndarray]:
        """uint8 (height, width, 3) of the states ``first`` to ``last`` - 1; by default to the one before the end.

        Args:
            log: a whole episode, or a tail whose metadata say when it begins (``segment_start_s``).
            first: index of the first state drawn.
            last: index past the last one.
        """
        sun, seed = SunPath(self.sun, self.config.port), int(log.metadata.get("seed") or 0)
        sun.start(seed)
        start_s = float(log.metadata.get("segment_start_s", 0.0))
        last = log.num_steps if last is None else last
        for state, time_s in zip(log.state[first:last], log.time[first:last], strict=True):
            moment = start_s + float(np.float32(time_s))  # to the bit what a dataset keeps: the noise hangs on it
            noise = sensor_noise(self.config, seed, moment)
            yield self.renderer.render(state[POSITION], state[QUATERNION], sun.at(moment), generator=noise)

    def close(self) -> None:
        if "renderer" in vars(self):
            self.renderer.close()


def check_drawing(drawing: dict[str, Any]) -> None:
    """Makes the renderer that these keyword arguments of ``Artist`` name, and closes it, before long work begins.

    The package's own renderer of its own station needs nothing, and is not made.

    Raises:
        InputError, FileFormatError, MissingDependencyError: as ``make_renderer``.
    """
    if drawing["renderer"] == "software" and drawing["station_mesh"] is None:
        return
    artist = Artist(**drawing)
    _ = artist.renderer
    artist.close()


def drawing_options(config: SpaceDockConfig) -> dict[str, Any]:
    """The keyword arguments of ``Artist`` for an environment's pictures, JSON-ready."""
    return {
        "camera": asdict(config.camera),
        "renderer": config.renderer,
        "station_mesh": config.station_mesh,
        "station_pose": None if config.station_pose is None else list(config.station_pose),
        "sun": config.sun,
    }
