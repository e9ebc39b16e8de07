"""Points sorted into cubic cells, for kernels that look at everything within a reach in one pass."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from rearticulate.arrays import Array, Float, Int

MOST = 160  # cells along one side; beyond it cells are longer than the reach


@dataclass(frozen=True)
class Cells:
    """order: points by cell; start (cells + 1,): first of each cell; low, size and shape of the grid."""

    order: Int[Array, " n"]
    start: Int[Array, " _"]
    low: Float[Array, " 3"]
    size: float
    shape: Int[Array, " 3"]

    def around(self, places: Float[Array, "n 3"]) -> tuple[Int[Array, "n 3"], Int[Array, " k"]]:
        """Cell (n, 3) of each of any places, and those that lie in the grid or right beside it, cell by cell."""
        cell = ((places - self.low) // self.size).astype(np.int64)
        near = np.flatnonzero(((cell >= -1) & (cell <= self.shape)).all(axis=1))
        x, y, z = (cell[near] + 1).T
        return cell, near[np.argsort((x * (self.shape[1] + 2) + y) * (self.shape[2] + 2) + z)]


@numba.njit(cache=True, nogil=True)
def _sort(points, low, size, shape):
    """Points by cell, in their order within one, and the first of each cell (counting sort)."""
    cell = np.empty(len(points), np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(len(points)):
        place = 0
        for c in range(3):
            place = place * shape[c] + int((points[i, c] - low[c]) // size)
        cell[i] = place
        start[place + 1] += 1
    start = np.cumsum(start)
    order, free = np.empty(len(points), np.int64), start.copy()
    for i in range(len(points)):
        order[free[cell[i]]] = i
        free[cell[i]] += 1
    return order, start


def sort_into_cells(points: Float[Array, "n 3"], reach: float) -> Cells:
    """Cells at least as long as the reach: what is within it of a place lies in the 27 cells around that place."""
    if len(points) == 0:
        return Cells(np.zeros(0, np.int64), np.zeros(2, np.int64), np.zeros(3), reach, np.ones(3, np.int64))
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(reach, float((high - low).max()) / MOST)
    shape = ((high - low) // size).astype(np.int64) + 1
    order, start = _sort(points, low, size, shape)
    return Cells(order, start, low, size, shape)
