"""Nearest neighbours in clouds that move a little at a time: a tree of boxes that is built anew from its last order.

A search is exact. It starts from the neighbours that were found last time, and visits the queries in an order in which
successive ones are near each other.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

LEAF = 16  # points of a leaf, at most
MARGIN = 1.0 + 1e-5  # old neighbours bound a search by a little more than their squared distance


class BoxTree:
    """Searches points (n, 3), in single precision. order (n,): rows of the points such that neighbours are near."""

    def __init__(self, points: Array):
        self._levels = max(0, int(np.ceil(np.log2(max(len(points), 1) / LEAF))))
        self._box = np.empty((2 << self._levels, 6), dtype=np.float32)
        self.order = np.arange(len(points))
        self.move(points)

    def move(self, points: Array) -> None:
        """The points (n, 3) are here now."""
        self._points = np.ascontiguousarray(points, dtype=np.float32)
        self._sorted = self._points[self.order]
        _build(self._sorted, self.order, self._box, self._levels)

    def search(self, queries: Array, found: IntArray, order: IntArray | None = None) -> Array:
        """Write the k nearest points of queries (n, 3) to found (n, k), which holds those of last time, or -1.

        order (n,): in which the queries are visited. Returns squared distances (n, k), nearest first; where there are
        no k points, -1 at infinity.
        """
        queries = queries.astype(np.float32, copy=False)
        order = np.arange(len(queries)) if order is None else order
        return _search(self._points, self._sorted, self.order, self._box, self._levels, queries, order, found)


@numba.njit(cache=True, nogil=True)
def _swap(points, order, i, j):
    for a in range(3):
        points[i, a], points[j, a] = points[j, a], points[i, a]
    order[i], order[j] = order[j], order[i]


@numba.njit(cache=True, nogil=True)
def _place(points, order, axis, lo, hi, middle):
    """Quickselect: rows lo to hi such that none before `middle` has a larger coordinate than any after."""
    first, last = lo, hi - 1
    while first < last:
        pivot = points[(first + last) >> 1, axis]
        i, j = first, last
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                _swap(points, order, i, j)
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


@numba.njit(cache=True, nogil=True)
def _build(points, order, box, levels):
    """Sort the points, and `order` with them, such that node k of level l has rows n k / 2^l to n (k + 1) / 2^l: halves
    along the widest side. box (2 ** (levels + 1), 6): lower and upper corners, node k of level l at 2^l + k."""
    n = len(points)
    for level in range(levels + 1):
        for k in range(1 << level):
            lo, hi, node = (n * k) >> level, (n * (k + 1)) >> level, (1 << level) + k
            axis = 0
            for a in range(3):
                low, high = np.float32(np.inf), np.float32(-np.inf)
                for i in range(lo, hi):
                    low, high = min(low, points[i, a]), max(high, points[i, a])
                box[node, a], box[node, 3 + a] = low, high
                if high - low > box[node, 3 + axis] - box[node, axis]:
                    axis = a
            if level < levels:
                _place(points, order, axis, lo, hi, (n * (2 * k + 1)) >> (level + 1))


@numba.njit(cache=True, nogil=True, inline="always")
def _squared(points, i, x, y, z):
    return (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 + (points[i, 2] - z) ** 2


@numba.njit(cache=True, nogil=True, inline="always")
def _to_box(box, node, x, y, z):
    """Squared distance of a point from a box, 0 inside."""
    zero = np.float32(0.0)
    dx = max(box[node, 0] - x, x - box[node, 3], zero)
    dy = max(box[node, 1] - y, y - box[node, 4], zero)
    dz = max(box[node, 2] - z, z - box[node, 5], zero)
    return dx * dx + dy * dy + dz * dz


@numba.njit(cache=True, nogil=True)
def _search(points, tree_points, order, box, levels, queries, visit, found):
    """`BoxTree.search`: depth first, nearer child first, nodes farther than the k-th best are left out."""
    n, k, leaf = len(order), found.shape[1], 1 << levels
    out = np.full((len(queries), k), np.float32(np.inf))
    stack, stack_d = np.empty(64, dtype=np.int64), np.empty(64, dtype=np.float32)
    for row in visit:
        x, y, z = queries[row, 0], queries[row, 1], queries[row, 2]
        limit = np.float32(0.0)
        for a in range(k):
            old = found[row, a]
            limit = max(limit, _squared(points, old, x, y, z)) if old >= 0 else np.float32(np.inf)
            found[row, a] = -1
        limit = np.float32(limit * MARGIN + 1e-30)
        top, stack[0], stack_d[0] = 0, 1, _to_box(box, 1, x, y, z)
        while top >= 0:
            node, near = stack[top], stack_d[top]
            top -= 1
            while near < limit and node < leaf:
                a, b = 2 * node, 2 * node + 1
                da, db = _to_box(box, a, x, y, z), _to_box(box, b, x, y, z)
                if db < da:
                    a, b, da, db = b, a, db, da
                if db < limit:
                    top += 1
                    stack[top], stack_d[top] = b, db
                node, near = a, da
            if near >= limit:
                continue
            for i in range((n * (node - leaf)) >> levels, (n * (node - leaf + 1)) >> levels):
                d = _squared(tree_points, i, x, y, z)
                if d < limit:
                    a = k - 1
                    while a > 0 and out[row, a - 1] > d:
                        out[row, a], found[row, a] = out[row, a - 1], found[row, a - 1]
                        a -= 1
                    out[row, a], found[row, a] = d, order[i]
                    limit = min(limit, out[row, k - 1])
    return out
