"""How open to the outside each corner is."""

from __future__ import annotations

import numpy as np


def openness(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return np.full(corners.shape[:2], 255, np.uint8)
