"""An approach as MP4 or GIF: the camera's view with its instruments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.files import aside
from lerobot_spacedock.metrics.episode import hill_coupled, port_of
from lerobot_spacedock.physics.frames import state_from_dataset_units
from lerobot_spacedock.report.instruments import frame_readings, overlay
from lerobot_spacedock.report.interpolate import dense

SUFFIXES = (".mp4", ".gif")
HOLD_LAST_s = 2.0  # the last view stays on for this long
GIF_COLOURS = 128
GIF_FPS = 50.0  # at most: a picture of one hundredth of a second is held for ten by most viewers
MOST_PICTURES = 100_000  # an hour at 24 a second


def film_times(log: EpisodeLog, fps: float, speed: float) -> np.ndarray:
    """s, (N,): the instants of a film ``speed`` times as fast as the flight; the last state included.

    Raises:
        InputError: it would have more than ``MOST_PICTURES``.
    """
    length_s = float(log.time[-1] - log.time[0]) / speed
    if not length_s * fps < MOST_PICTURES:
        allowed = f"a film of fewer than {MOST_PICTURES:,} pictures"
        raise InputError("--speed, --fps", f"{speed:g}, {fps:g}: a film of {length_s:.3g} s", allowed)
    return np.linspace(log.time[0], log.time[-1], max(2, int(np.ceil(length_s * fps)) + 1))


def film(log: EpisodeLog, artist, time: np.ndarray, caption: str) -> Iterator[np.ndarray]:
    """Pictures with instruments, uint8 (H, W, 3), one an instant.

    Args:
        log: the episode.
        artist: draws the states of a log (``dataset.frames.Artist``).
        time: s, (N,).
        caption: upper left corner.
    """
    episode = dense(log, time)
    port, coupled = port_of(log.metadata), hill_coupled(log.metadata)
    states = state_from_dataset_units(episode.state)
    for frame, state, seconds in zip(artist.draw(episode, 0, len(time)), states, time, strict=True):
        instruments = frame_readings(state, port, hill_coupling=coupled)
        yield overlay(frame, instruments, time_s=float(seconds), caption=caption)


def write_film(path: Path, pictures: Iterable[np.ndarray], fps: float) -> Path:
    """Writes MP4 (H.264) or GIF by the file's ending, aside and then renamed. Returns the path.

    Raises:
        InputError: another ending.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError("--video", str(path), f"a file that ends in {' or '.join(SUFFIXES)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    with aside(path) as own:
        (_write_mp4 if path.suffix.lower() == ".mp4" else _write_gif)(own, pictures, fps)
    return path


def _write_mp4(path: Path, pictures: Iterable[np.ndarray], fps: float) -> None:
    import av

    with av.open(str(path), "w", format="mp4") as container:
        stream = None
        for picture in _held(pictures, round(HOLD_LAST_s * fps)):
            if stream is None:
                stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt, stream.options = "yuv420p", {"crf": "20", "preset": "medium"}
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def _write_gif(path: Path, pictures: Iterable[np.ndarray], fps: float) -> None:
    from PIL import Image

    images = [Image.fromarray(p).quantize(GIF_COLOURS, dither=Image.Dither.NONE) for p in pictures]
    # a GIF counts in hundredths of a second: what is rounded off must not add up
    ends = np.round(np.arange(len(images)) * (100.0 / fps)).astype(int)
    durations = [*(10 * np.diff(ends)).tolist(), round(1000 * HOLD_LAST_s)]
    images[0].save(
        path, format="GIF", save_all=True, append_images=images[1:], duration=durations, loop=0, optimize=True
    )


def _held(pictures: Iterable[np.ndarray], extra: int) -> Iterator[np.ndarray]:
    last = None
    for last in pictures:
        yield last
    if last is not None:
        for _ in range(extra):
            yield last
