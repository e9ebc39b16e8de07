"""Neighbours in point clouds."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


def nearest(tree: KDTree, points: Array, k: int = 1, within: float = np.inf) -> tuple[Array, IntArray]:
    """Distance and row of the k nearest points ((n,) for k = 1, else (n, k)); inf and the cloud's size beyond `within`.

    On one thread: whole fits run side by side, which uses the cores better.
    """
    return tree.query(points, k=k, distance_upper_bound=within)  # type: ignore[return-value]


def search_tree(points: Array) -> KDTree:
    """A tree that is faster to build and to search than SciPy's defaults on surfaces."""
    return KDTree(points, leafsize=32, balanced_tree=False)


def contact(a: Array, b: Array, pairs: int) -> Array:
    """(3,) where two clouds meet: middle of the points of a (n, 3) nearest to b (m, 3) and of their partners."""
    d, j = nearest(search_tree(b), a)
    near = np.argsort(d, kind="stable")[:pairs]
    return (a[near] + b[j[near]]).mean(axis=0) / 2


def rms_radius(points: Array) -> float:
    """Root mean square distance of points (N, 3) from their centroid."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


@numba.njit(cache=True, nogil=True)
def _farthest(points, first, count):
    chosen = np.empty(count, dtype=np.int64)
    nearest = np.full(len(points), np.inf)
    j = first
    for k in range(count):
        chosen[k] = j
        best, best_d = 0, -1.0
        for i in range(len(points)):
            d = 0.0
            for a in range(3):
                d += (points[i, a] - points[j, a]) ** 2
            nearest[i] = min(nearest[i], d)
            if nearest[i] > best_d:
                best, best_d = i, nearest[i]
        j = best
    return chosen


def farthest_points(points: Array, count: int) -> IntArray:
    """Indices of `count` farthest-point samples of points (N, 3), starting with the one farthest from the centroid."""
    first = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())
    return _farthest(np.ascontiguousarray(points), first, min(count, len(points)))
