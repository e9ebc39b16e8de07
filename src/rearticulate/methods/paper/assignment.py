"""Exact assignment between two clouds of equal size under the squared distance.

Row reduction, augmenting row reduction and shortest augmenting paths (Jonker & Volgenant 1987; Crouse 2016, the solver
of the paper). A solution starts from the last one: its prices are valid for any clouds, and pairs that they still
justify stay. Costs are computed where they are needed; there is no matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

TRIES = 2  # of augmenting row reduction, a point: what is left then is quicker to solve by paths
LANES = 16
ROUND_OFF = 1e-12  # share of the largest squared length that counts as no difference between costs


@dataclass(frozen=True)
class Assignment:
    """column (n,): the point of the second cloud that each point of the first is given. price (n,) of the second."""

    column: IntArray
    price: Array


def assign(x: Array, y: Array, last: Assignment | None = None) -> Assignment:
    """The assignment of x (n, 3) to y (n, 3) with the lowest sum of squared distances. last: of clouds nearby."""
    x, y = x.astype(np.float64), y.astype(np.float64)
    column = np.full(len(x), -1) if last is None else last.column.copy()
    price = np.zeros(len(x)) if last is None else last.price.copy()
    if len(x):
        slack = ROUND_OFF * max(float((x * x).sum(axis=1).max()), float((y * y).sum(axis=1).max()))
        _solve(x, np.ascontiguousarray(y.T), column, price, slack)
    return Assignment(column, price)


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _reduced(x, y, price, i, out):
    """Write |x_i - y_j|^2 - price_j of every j to out."""
    a, b, c = x[i, 0], x[i, 1], x[i, 2]
    for j in range(len(price)):
        dx, dy, dz = a - y[0, j], b - y[1, j], c - y[2, j]
        out[j] = dx * dx + dy * dy + dz * dz - price[j]


@numba.njit(cache=True, nogil=True)
def _keep_tight(x, y, column, price, row, slack):
    """Keep the pairs whose reduced cost is the least of their row. Returns the rows without a partner."""
    n = len(price)
    cost, free, count = np.empty(n), np.empty(n, dtype=np.int64), 0
    for i in range(n):
        j, cheaper = column[i], 0
        if j >= 0:
            _reduced(x, y, price, i, cost)
            limit = cost[j] - slack
            for other in range(n):
                cheaper += cost[other] < limit
        if j >= 0 and row[j] < 0 and cheaper == 0:
            row[j] = i
        else:
            column[i] = -1
            free[count] = i
            count += 1
    return free[:count]


@numba.njit(cache=True, nogil=True)
def _reduce_rows(x, y, column, price, row, free):
    """Give each free row its cheapest column, whose price falls to what makes the second cheapest as good; a row that
    loses its column is free again. Returns the rows that are free in the end."""
    n = len(price)
    cost, k, count, tries = np.empty(n), 0, 0, 0
    while k < len(free) and tries < TRIES * n:
        tries += 1
        i = free[k]
        k += 1
        _reduced(x, y, price, i, cost)
        least, second, best = np.inf, np.inf, -1
        for j in range(n):
            if cost[j] < second:
                if cost[j] < least:
                    least, second, best = cost[j], least, j
                else:
                    second = cost[j]
        loser = row[best]
        if least < second < np.inf:
            price[best] -= second - least
        elif loser >= 0:
            free[count] = i
            count += 1
            continue
        row[best], column[i] = i, best
        if loser >= 0:
            column[loser] = -1
            k -= 1
            free[k] = loser
    for rest in range(k, len(free)):
        free[count] = free[rest]
        count += 1
    return free[:count]


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _shorten(cost, base, i, reach, before, low, at):
    """Shorten reach to base + cost, by way of row i; returns the nearest column that is not closed (reach -inf) and its
    reach. All a whole number of lanes long, which the compiler turns into vector instructions."""
    low[:] = np.inf
    for block in range(len(cost) // LANES):
        for lane in range(LANES):
            j = block * LANES + lane
            there = base + cost[j]
            shorter = there < reach[j]
            there = there if shorter else reach[j]
            reach[j] = there
            before[j] = i if shorter else before[j]
            there = there if there > -np.inf else np.inf
            nearer = there < low[lane]
            low[lane] = there if nearer else low[lane]
            at[lane] = j if nearer else at[lane]
    lane = 0
    for other in range(1, LANES):
        lane = other if low[other] < low[lane] else lane
    return at[lane], low[lane]


@numba.njit(cache=True, nogil=True)
def _augment(x, y, column, price, row, start, work):
    """Give row `start` a column along the shortest path of reduced costs (Dijkstra), and correct the prices."""
    cost, reach, before, closed, length_of, low, at = work
    reach[:] = np.inf
    i, length, count = start, 0.0, 0
    while True:
        _reduced(x, y, price, i, cost)
        base = 0.0 if i == start else length - cost[column[i]]
        j, length = _shorten(cost, base, i, reach, before, low, at)
        if row[j] < 0:
            break
        closed[count], length_of[count] = j, length
        count += 1
        reach[j] = -np.inf
        i = row[j]
    for k in range(count):
        price[closed[k]] -= length - length_of[k]
    i = -1
    while i != start:
        i = before[j]
        row[j] = i
        column[i], j = j, column[i]


@numba.njit(cache=True, nogil=True)
def _solve(x, y, column, price, slack):
    """`assign`, in place. x (n, 3), y (3, n)."""
    n = len(price)
    row = np.full(n, -1)
    free = _keep_tight(x, y, column, price, row, slack)
    free = _reduce_rows(x, y, column, price, row, free)
    padded = -(-n // LANES) * LANES
    cost, before, at = np.full(padded, np.inf), np.empty(padded, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    work = cost, np.empty(padded), before, before.copy(), np.empty(padded), np.empty(LANES), at
    for start in free:
        _augment(x, y, column, price, row, start, work)
