"""Where the chaser has been: counts of visited cells, kept sparse, so that memory does not grow with episodes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

CELL_M = 0.1
FAR_M = 100.0  # states farther out than this on either axis are counted apart, in ``outside``
_STRIDE = int(2 * FAR_M / CELL_M) + 1


@dataclass
class CellCounts:
    """Visits a cell of two coordinates, cells of ``CELL_M``.

    Attributes:
        cells: flat cell index, ascending, (C,).
        counts: visits, (C,).
        outside: visits beyond ``FAR_M``.
    """

    cells: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    counts: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    outside: int = 0

    @property
    def total(self) -> int:
        return int(self.counts.sum()) + self.outside


def count_cells(horizontal: np.ndarray, vertical: np.ndarray) -> CellCounts:
    """Counts the cells that points fall into. m, (N,), (N,)."""
    inside = (np.abs(horizontal) < FAR_M) & (np.abs(vertical) < FAR_M)
    i = np.floor((horizontal[inside] + FAR_M) / CELL_M).astype(np.int64)
    j = np.floor((vertical[inside] + FAR_M) / CELL_M).astype(np.int64)
    cells, counts = np.unique(i * _STRIDE + j, return_counts=True)
    return CellCounts(cells, counts, int(np.sum(~inside)))


def merge(first: CellCounts, second: CellCounts) -> CellCounts:
    """The counts of both."""
    cells, place = np.unique(np.concatenate([first.cells, second.cells]), return_inverse=True)
    counts = np.bincount(place, np.concatenate([first.counts, second.counts]), len(cells)).astype(np.int64)
    return CellCounts(cells, counts, first.outside + second.outside)


def density(
    cells: CellCounts, horizontal_m: tuple[float, float], vertical_m: tuple[float, float], smoothing_m: float = 0.2
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Visitation density over a window: share of all visits per square metre, smoothed by a Gaussian.

    Args:
        cells: the counts.
        horizontal_m: window, its ends rounded down to whole cells.
        vertical_m: window, its ends rounded down to whole cells.
        smoothing_m: standard deviation of the smoothing kernel.

    Returns:
        Cell centres (H,) and (V,) in m, and density (V, H) in 1/m²; its integral over the whole plane is the share
        of visits within ``FAR_M``. No visit gives zeros.
    """
    i0, i1 = (int(np.floor((edge + FAR_M) / CELL_M)) for edge in horizontal_m)
    j0, j1 = (int(np.floor((edge + FAR_M) / CELL_M)) for edge in vertical_m)
    pad = int(np.ceil(4 * smoothing_m / CELL_M))  # cells beyond the window still smooth into it
    i, j = cells.cells // _STRIDE - i0 + pad, cells.cells % _STRIDE - j0 + pad
    grid = np.zeros((j1 - j0 + 2 * pad, i1 - i0 + 2 * pad))
    keep = (i >= 0) & (i < grid.shape[1]) & (j >= 0) & (j < grid.shape[0])
    grid[j[keep], i[keep]] = cells.counts[keep]
    if cells.total:
        grid = ndimage.gaussian_filter(grid, smoothing_m / CELL_M, mode="constant") / (cells.total * CELL_M**2)
    grid = grid[pad : pad + j1 - j0, pad : pad + i1 - i0]
    x = (np.arange(i0, i1) + 0.5) * CELL_M - FAR_M
    y = (np.arange(j0, j1) + 0.5) * CELL_M - FAR_M
    return x, y, grid
