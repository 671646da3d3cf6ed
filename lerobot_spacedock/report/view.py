"""``spacedock view``: look at an episode: in Rerun, as a film, or as one picture."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from lerobot_spacedock.camera.config import BACKENDS, CameraConfig
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.frames import Artist
from lerobot_spacedock.dataset.stored_episode import DatasetEpisode
from lerobot_spacedock.episode_log import EpisodeLog, read_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError, one_of, reading
from lerobot_spacedock.metrics.episode import hill_coupled, port_of
from lerobot_spacedock.physics.frames import state_from_dataset_units
from lerobot_spacedock.report.instruments import frame_readings, overlay
from lerobot_spacedock.report.interpolate import dense
from lerobot_spacedock.report.rerun_scene import show_episode
from lerobot_spacedock.report.video import GIF_FPS, SUFFIXES, film, film_times, write_film

FPS, SPEED = 24.0, 4.0  # of films, where not given


@dataclass
class ViewConfig:
    """Look at an episode. Without --save, --video or --render a Rerun window opens."""

    # An episode log (episode_*.parquet)
    log: Path | None = None
    # Root of a LeRobotDataset, in place of a log
    dataset: Path | None = None
    # Which episode of the dataset; default: 0
    episode: int | None = None
    # Write a Rerun recording (.rrd) instead of opening a window
    save: Path | None = None
    # Write a film of the approach with instruments (.mp4 or .gif)
    video: Path | None = None
    # Write one picture with instruments (.png)
    render: Path | None = None
    # s, instant of --render; default: the last state
    at: float | None = None
    # Pictures a second of the film, up to 50 in a GIF; default: 24
    fps: float | None = None
    # How many times faster than the flight the film runs; default: 4
    speed: float | None = None
    # Rows of the pictures; default: as the log states, else 480; a film has 480 at least
    height: int | None = None
    # Columns of the pictures; default: as the log states, else 640
    width: int | None = None
    # Level of detail of the station, low or high; default: as the log states, else low
    detail: str | None = None
    # software or pyrender; default: as the log states, else software
    renderer: str | None = None
    # Camera frames in Rerun; false leaves them out
    camera: bool = True


def view(cfg: ViewConfig) -> int:
    """Shows or writes what was asked for, and says where it is."""
    _check(cfg)
    source = DatasetEpisode(cfg.dataset, cfg.episode or 0) if cfg.dataset else None
    log = source.log() if source else read_episode_log(cfg.log)
    name = f"{cfg.dataset.name}, episode {source.episode}" if source else cfg.log.name
    if _in_rerun_alone(cfg):
        _check_drawn(cfg, source)
        if cfg.save is None and sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
            mend = "Or --video=FILE.mp4, --render=FILE.png."
            raise InputError("--save", "nothing, where there is no display", "--save=FILE.rrd", mend)
    artist = StatedArtist(cfg, log.metadata)
    try:
        if cfg.render is not None:
            _write_picture(cfg, log, artist, _caption(log, name))
            print(f"Picture: {cfg.render}")
        if cfg.video is not None:
            fps = cfg.fps or FPS
            times = film_times(log, fps, cfg.speed or SPEED)
            pictures = tqdm(
                film(log, artist, times, _caption(log, name)), total=len(times), unit="frame", desc="filming"
            )
            print(f"Film: {write_film(cfg.video, pictures, fps)}")
        if cfg.save is not None or _in_rerun_alone(cfg):
            frames = _frames(cfg, log, source, artist)
            show_episode(log, frames, vfov_deg=artist.vfov_deg, save=cfg.save, name=name, detail="low")
            print(f"Recording: {cfg.save}" if cfg.save else "Opened in the Rerun viewer.")
    finally:
        artist.close()
    print(f"Next: {_next(cfg)}")
    return 0


def _in_rerun_alone(cfg: ViewConfig) -> bool:
    return cfg.video is None and cfg.render is None


def _check_drawn(cfg: ViewConfig, source: DatasetEpisode | None) -> None:
    """Raises InputError where an option is of pictures to draw, and there is none to draw for Rerun."""
    if not cfg.camera:
        reason = "nothing, with --camera=false"
    elif _has_pictures(source):
        reason = "nothing: the dataset's own pictures are shown"
    else:
        return
    for name, given in {**_given(cfg), "renderer": cfg.renderer}.items():
        if given is not None:
            raise InputError(f"--{name}", given, reason, "It goes with --video or --render.")


def _has_pictures(source: DatasetEpisode | None) -> bool:
    """Whether an episode has pictures of its own to show."""
    return source is not None and (schema.IMAGE in source.cameras or len(source.cameras) == 1)


def _next(cfg: ViewConfig) -> str:
    """The command that shows what this one did not: the film after a picture, the recording after a film."""
    if cfg.save is not None:
        return f"rerun {cfg.save}"
    source = f"--log={cfg.log}" if cfg.log else f"--dataset={cfg.dataset} --episode={cfg.episode or 0}"
    if cfg.video is not None:
        return f"spacedock view {source} --save={cfg.video.with_suffix('.rrd')}"
    return f"spacedock view {source} --video={(cfg.render or Path('approach')).with_suffix('.mp4')}"


def _given(cfg: ViewConfig) -> dict[str, Any]:
    """What the user asks of the camera, in place of what the log states of it."""
    asked = {"detail": cfg.detail, "height": cfg.height, "width": cfg.width}
    return {name: value for name, value in asked.items() if value is not None}


def _film_size(camera: Mapping[str, Any]) -> dict[str, int]:
    """The size that a film is drawn in: what a policy saw small, people see with room for instruments."""
    rows, columns = (int(camera.get(key, getattr(CameraConfig, key))) for key in ("height", "width"))
    scale = max(1.0, CameraConfig.height / max(rows, 1))
    return {"height": round(rows * scale), "width": 2 * round(columns * scale / 2)}


@contextmanager
def _as_stated(place: Path) -> Iterator[None]:
    """Around what a log says of its camera, its Sun and its station, which may be anything: errors name the file."""
    try:
        with reading(place, "an episode to look at"):
            yield
    except InputError as error:
        raise FileFormatError(f"{place}: {error}") from error


class StatedArtist:
    """Draws states as the log's environment would have, by what the log states of it."""

    def __init__(self, cfg: ViewConfig, metadata: Mapping[str, Any]) -> None:
        self._place = cfg.dataset or cfg.log
        with _as_stated(self._place):
            self._artist = self._read(cfg, metadata)

    def _read(self, cfg: ViewConfig, metadata: Mapping[str, Any]) -> Artist:
        config = metadata.get("config")
        config = config if isinstance(config, Mapping) else {}
        stated = config.get("camera")
        camera = dict(stated) if isinstance(stated, Mapping) else {}
        camera |= {"port": port_of(metadata).name} | _given(cfg)
        if cfg.video is not None and cfg.height is None and cfg.width is None:
            camera |= _film_size(camera)
        self.vfov_deg = float(camera.get("vfov_deg", CameraConfig.vfov_deg))
        renderer = cfg.renderer or config.get("renderer") or BACKENDS[0]
        options = {"camera": camera, "renderer": renderer, "sun": config.get("sun") or "fixed"}
        return Artist(**options, **{key: config.get(key) for key in ("station_mesh", "station_pose")})

    def draw(self, log: EpisodeLog, first: int, last: int) -> Iterator[np.ndarray]:
        """uint8 (H, W, 3) of the states ``first`` to ``last`` − 1."""
        pictures = self._artist.draw(log, first, last)
        for _ in range(first, last):
            with _as_stated(self._place):
                picture = next(pictures)
            yield picture

    def close(self) -> None:
        self._artist.close()


def _frames(
    cfg: ViewConfig, log: EpisodeLog, source: DatasetEpisode | None, artist: StatedArtist
) -> Iterator[np.ndarray]:
    if not cfg.camera:
        return iter(())
    if _has_pictures(source):
        return source.frames()
    drawn = artist.draw(log, 0, len(log.time))
    return iter(tqdm(drawn, total=len(log.time), unit="frame", desc="drawing"))


def _write_picture(cfg: ViewConfig, log: EpisodeLog, artist: StatedArtist, caption: str) -> None:
    from PIL import Image

    seconds = float(log.time[-1]) if cfg.at is None else cfg.at
    if not log.time[0] <= seconds <= log.time[-1]:
        raise InputError("--at", seconds, f"{log.time[0]:g} to {log.time[-1]:.2f} s, from the first state to the last")
    moment = dense(log, np.array([seconds]))
    (frame,) = artist.draw(moment, 0, 1)
    state = state_from_dataset_units(moment.state)[0]
    instruments = frame_readings(state, port_of(log.metadata), hill_coupling=hill_coupled(log.metadata))
    cfg.render.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(overlay(frame, instruments, time_s=seconds, caption=caption)).save(cfg.render)


def _caption(log: EpisodeLog, name: str) -> str:
    return str(log.metadata.get("label") or name)


def _check(cfg: ViewConfig) -> None:
    if (cfg.log is None) == (cfg.dataset is None):
        given = "both" if cfg.log else "neither"
        raise InputError(
            "--log, --dataset", given, "one of the two", "For example: --log logs/act/episode_001000.parquet."
        )
    if cfg.log is not None and not cfg.log.is_file():
        raise InputError("--log", str(cfg.log), "an episode log that exists (episode_*.parquet)")
    if not cfg.camera and cfg.save is None and not _in_rerun_alone(cfg):
        raise InputError("--camera", "false", "nothing, unless --save is given")
    for flag, given, user, needed in (
        ("--episode", cfg.episode, cfg.dataset, "--dataset"),
        ("--at", cfg.at, cfg.render, "--render"),
        ("--fps", cfg.fps, cfg.video, "--video"),
        ("--speed", cfg.speed, cfg.video, "--video"),
    ):
        if given is not None and user is None:
            raise InputError(flag, given, f"nothing, unless {needed} is given")
    if cfg.renderer is not None:
        one_of("--renderer", cfg.renderer, BACKENDS)
    CameraConfig(**_given(cfg))
    for flag, path, endings in (
        ("--video", cfg.video, SUFFIXES),
        ("--save", cfg.save, (".rrd",)),
        ("--render", cfg.render, (".png",)),
    ):
        if path is not None and path.suffix.lower() not in endings:
            raise InputError(flag, str(path), f"a file that ends in {' or '.join(endings)}")
    if cfg.at is not None and not math.isfinite(cfg.at):
        raise InputError("--at", cfg.at, "seconds since the first state")
    for flag, value in (("--fps", cfg.fps), ("--speed", cfg.speed)):
        if value is not None and not 0.0 < value <= 1000.0:
            raise InputError(flag, value, "above 0, up to 1000")
    if cfg.video is not None and cfg.video.suffix.lower() == ".gif" and (cfg.fps or FPS) > GIF_FPS:
        raise InputError("--fps", cfg.fps, f"up to {GIF_FPS:g} in a GIF", "An .mp4 takes more.")
