"""Agreement of two segmentations of the same points, all from their contingency table."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

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


def match_parts(true: IntArray, predicted: IntArray, n_true: int) -> IntArray:
    """(n_true,) predicted part of each true part: the one-to-one assignment that shares most points; -1 where none."""
    table = contingency(true, predicted)
    rows, columns = linear_sum_assignment(table, maximize=True)
    match = np.full(n_true, -1, dtype=np.int64)
    shared = table[rows, columns] > 0
    match[rows[shared]] = columns[shared]
    return match
