"""Neighbours in point clouds."""

from __future__ import annotations

import numba
import numpy as np
from scipy.spatial import KDTree

from rearticulate.arrays import Array, Float, Int


def nearest(
    tree: KDTree, points: Float[Array, "n 3"], k: int = 1, within: float = np.inf
) -> tuple[Float[Array, " n"], Int[Array, " n"]] | tuple[Float[Array, "n k"], Int[Array, "n k"]]:
    """Distance and row of the k nearest points (no axis k for k = 1); inf and the cloud's size beyond `within`.

    On one thread: whole fits run side by side, which uses the cores better.
    """
    return tree.query(points, k=k, distance_upper_bound=within)  # type: ignore[return-value]


def search_tree(points: Float[Array, "n 3"]) -> KDTree:
    """A tree that is faster to build and to search than SciPy's defaults on surfaces."""
    return KDTree(points, leafsize=32, balanced_tree=False)


def contact(a: Float[Array, "n 3"], b: Float[Array, "m 3"], pairs: int) -> Float[Array, " 3"]:
    """Where two clouds meet: middle of the points of a nearest to b and of their partners."""
    d, j = nearest(search_tree(b), a)
    near = np.argsort(d, kind="stable")[:pairs]
    return (a[near] + b[j[near]]).mean(axis=0) / 2


def rms_radius(points: Float[Array, "N 3"]) -> float:
    """Root mean square distance of points from their centroid."""
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


def farthest_points(points: Float[Array, "N 3"], count: int) -> Int[Array, " n"]:
    """Indices of `count` farthest-point samples, starting with the one farthest from the centroid."""
    first = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())
    return _farthest(np.ascontiguousarray(points), first, min(count, len(points)))
