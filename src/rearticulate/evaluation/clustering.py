"""Agreement of two segmentations of the same points, all from their contingency table."""

from __future__ import annotations

import numpy as np

from rearticulate.records import Array, IntArray


def contingency(a: IntArray, b: IntArray) -> Array:
    """Number of points with label i in a and k in b. a, b: (N,) labels from 0. Returns (max a + 1, max b + 1)."""
    table = np.zeros((int(a.max()) + 1, int(b.max()) + 1))
    np.add.at(table, (a, b), 1.0)
    return table


def rand_index(a: IntArray, b: IntArray) -> float:
    """Share of the ordered pairs of points, i = j included, on which two labellings (N,) agree (Rand 1971)."""
    table = contingency(a, b)
    apart = (table.sum(0) ** 2).sum() + (table.sum(1) ** 2).sum() - 2 * (table**2).sum()
    return float(1.0 - apart / len(a) ** 2)
