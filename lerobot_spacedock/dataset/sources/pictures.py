"""Stored pictures as frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from lerobot_spacedock.errors import FileFormatError, reading

LARGEST_PIXELS = 50_000_000


def read_picture(file: Path) -> np.ndarray:
    """One picture as uint8 (height, width, 3); an alpha channel is dropped, grey becomes RGB.

    Raises:
        FileFormatError: missing, truncated, or not a picture.
    """
    from PIL import Image

    try:
        with reading(file, "a picture"), Image.open(file) as picture:
            if picture.width * picture.height > LARGEST_PIXELS:
                raise FileFormatError(f"{file}: {picture.width} x {picture.height} pixels; 50 million are the most.")
            return np.asarray(picture.convert("RGB"))
    except FileNotFoundError:
        raise FileFormatError(f"{file}: missing.") from None


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
