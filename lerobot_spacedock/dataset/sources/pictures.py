"""Stored pictures as frames."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from lerobot_spacedock.errors import FileFormatError, reading

KINDS = ("PNG", "JPEG")  # of what Pillow reads, some start programs of their own (EPS) and none other is a frame
LARGEST_PIXELS = 4096 * 4096
LARGEST_BYTES = 128 << 20  # so many pixels of 16 bits a channel, not compressed at all


def read_picture(file: Path) -> np.ndarray:
    """One picture as uint8 (height, width, 3); an alpha channel is dropped, grey becomes RGB.

    Raises:
        FileFormatError: missing, truncated, too large, or not a PNG or JPEG.
    """
    try:
        if file.stat().st_size > LARGEST_BYTES:
            raise FileFormatError(f"{file}: larger than {LARGEST_BYTES >> 20} MiB, the most a picture takes.")
        content = file.read_bytes()
    except FileNotFoundError:
        raise FileFormatError(f"{file}: missing.") from None
    return decode_picture(content, file)


def decode_picture(content: bytes, place: Path | str) -> np.ndarray:
    """The same of a picture that is in memory: Pillow makes room for what a chunk of a file on disk claims to hold.

    Args:
        content: a PNG or JPEG file; zeros after its end do no harm.
        place: for error messages.
    """
    from PIL import Image

    with reading(place, "a picture"), Image.open(io.BytesIO(content), formats=KINDS) as picture:
        # what the header claims, before there is room made for it
        if picture.width * picture.height > LARGEST_PIXELS:
            raise FileFormatError(
                f"{place}: {picture.width} x {picture.height} pixels; {LARGEST_PIXELS:,} (4096 x 4096) are the most."
            )
        return np.asarray(picture if picture.mode == "RGB" else picture.convert("RGB"))


def resized(frames: Iterable[np.ndarray], height: int, width: int, sizes: set[tuple[int, int]]) -> Iterator[np.ndarray]:
    """The frames at another size, by area averaging where they shrink; untouched where it is theirs already.

    Args:
        frames: uint8 (h, w, 3).
        height: pixels.
        width: pixels.
        sizes: takes up the (h, w) that were changed.
    """
    for frame in frames:
        if frame.shape[:2] == (height, width):
            yield frame
            continue
        import cv2

        sizes.add(frame.shape[:2])
        shrinks = frame.shape[0] >= height and frame.shape[1] >= width
        yield cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
