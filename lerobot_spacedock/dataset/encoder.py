"""The video encoder and its settings, tried before anything is flown or read for it."""

from __future__ import annotations

import logging
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.errors import InputError

if TYPE_CHECKING:
    from lerobot_spacedock.dataset.record import DatasetLayout, Storage

TRIED_FRAMES = 3


def encoder_config(storage: Storage) -> Any:
    """LeRobot's settings of the encoder.

    Raises:
        InputError: LeRobot or this build of FFmpeg does not have the codec, or the codec does not take a setting.
    """
    from lerobot.configs import RGBEncoderConfig

    known = available_codecs()
    if storage.vcodec not in known:
        raise InputError("--storage.vcodec", storage.vcodec, " | ".join(known))
    try:
        return RGBEncoderConfig(vcodec=storage.vcodec, crf=storage.crf, g=storage.gop)
    except ValueError as error:
        given = f"vcodec={storage.vcodec} crf={storage.crf} gop={storage.gop}"
        raise InputError("--storage", given, "what the codec takes", f"{error}.") from error


def available_codecs() -> list[str]:
    """The codecs that LeRobot writes and this build of FFmpeg has; those of a GPU may still fail without one."""
    from lerobot.configs.video import VALID_VIDEO_CODECS
    from lerobot.datasets import detect_available_encoders_pyav

    return detect_available_encoders_pyav(sorted(VALID_VIDEO_CODECS))


def check_encoder(layout: DatasetLayout) -> None:
    """Encodes a few frames and forgets them; nothing where the layout has no video.

    Raises:
        InputError: it cannot be done with these settings here.
    """
    if not layout.image or layout.storage.kind != "video":
        return
    quiet_encoders()
    config = encoder_config(layout.storage)
    from lerobot.datasets.video_utils import StreamingVideoEncoder

    frame = np.zeros((layout.height, layout.width, 3), dtype=np.uint8)
    encoder = StreamingVideoEncoder(schema.FPS, rgb_encoder=config)
    said_by = logging.getLogger("lerobot.datasets.video_utils")
    before = said_by.level
    said_by.setLevel(logging.CRITICAL)  # what it says of a failure is in the error
    try:
        # its thread may still be writing when it has failed
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
            encoder.start_episode([schema.IMAGE], Path(scratch))
            for _ in range(TRIED_FRAMES):
                encoder.feed_frame(schema.IMAGE, frame)
            encoder.finish_episode()
    except RuntimeError as error:
        codec = layout.storage.vcodec
        others = " | ".join(name for name in available_codecs() if name != codec)
        raise InputError("--storage.vcodec", codec, others, f"It does not work here: {error}.") from error
    finally:
        encoder.close()
        said_by.setLevel(before)


def quiet_encoders() -> None:
    """Errors only from the video libraries: their settings and passes, once an episode, would bury the progress."""
    os.environ.setdefault("SVT_LOG", "1")
    import av

    av.logging.set_libav_level(av.logging.ERROR)
