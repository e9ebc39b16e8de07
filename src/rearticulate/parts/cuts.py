"""Labels that cost least: costs of points and of borders between neighbours in one sheet, by alpha expansion (Boykov,
Veksler & Zabih 2001). One expansion is a minimum cut: exactly the best set of points to go over to one part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.observe.frames import Frames

KEPT = 8  # neighbours in the same sheet
DISTANCE, OFFSET = 4.0, 0.4  # spacings; Gaussian weights of a neighbour's distance and of its offset from the plane
AGREEMENT = 0.7  # |cosine| between the normals of neighbours in one sheet, at least
STRENGTH = 1.25  # of all borders of a point with its neighbours, in units of misfit
ISOLATED = 0.5  # a point with less weight around it than this is held less firmly
UNIT = 1000  # capacities are whole numbers


@dataclass(frozen=True)
class Borders:
    """Pairs of neighbours i, j of one sheet and one frame, and what a border between the two costs."""

    i: Int[Array, " E"]
    j: Int[Array, " E"]
    cost: Float[Array, " E"]

    def between(self, labels: Int[Array, " M"]) -> float:
        """Cost of all borders of labels."""
        return float(self.cost[labels[self.i] != labels[self.j]].sum())

    @cached_property
    def _of_point(self) -> tuple[Int[Array, " _"], Int[Array, " _"]]:
        """The pairs of each point, and where those of a point begin."""
        points = np.concatenate([self.i, self.j])
        order = np.argsort(points, kind="stable")
        return order % max(len(self.i), 1), np.searchsorted(points[order], np.arange(points.max(initial=-1) + 2))

    def grown(self, labels: Int[Array, " M"], members: Int[Array, " n"], p: int | np.integer) -> float:
        """By how much the cost of all borders grows if members go to p."""
        pairs, start = self._of_point
        return _grown(self.i, self.j, self.cost, pairs, start, labels, members, p)


@numba.njit(cache=True, nogil=True)
def _grown(i, j, cost, pairs, start, labels, members, p):
    goes = np.zeros(len(labels), np.bool_)
    goes[members] = True
    total = 0.0
    for m in members:
        if m + 1 >= len(start):
            continue
        for e in pairs[start[m] : start[m + 1]]:
            other = j[e] if i[e] == m else i[e]
            if goes[other]:  # the pair comes twice
                total -= 0.5 * cost[e] * (labels[m] != labels[other])
            else:
                total += cost[e] * (int(labels[other] != p) - int(labels[m] != labels[other]))
    return total


@numba.njit(cache=True, nogil=True)
def _weights(points, normals, near, distance, scale, offset_scale, agreement, kept, strength, isolated, out, chosen):
    """The heaviest neighbours of each point in its own sheet, and what a border with each costs."""
    weight = np.empty(near.shape[1])
    for i in range(len(points)):
        for k in range(near.shape[1]):
            weight[k] = 0.0
            j = near[i, k]
            if j < 0:
                continue
            here, there, agree = 0.0, 0.0, 0.0
            for c in range(3):
                d = points[j, c] - points[i, c]
                here += d * normals[i, c]
                there += d * normals[j, c]
                agree += normals[i, c] * normals[j, c]
            if abs(agree) > agreement:
                offset = max(abs(here), abs(there)) / offset_scale
                weight[k] = np.exp(-((distance[i, k] / scale) ** 2) - offset * offset)
        total = 0.0
        for m in range(kept):
            best = weight.argmax()
            out[i, m], chosen[i, m] = weight[best], near[i, best]
            total += weight[best]
            weight[best] = -1.0
        for m in range(kept):
            out[i, m] *= strength / max(total, isolated)


@numba.njit(cache=True, nogil=True)
def _pairs(weight, chosen, least):
    """Points i, j of which one has the other among its neighbours, once each, and the sum of their weights."""
    i, j, cost, n = np.empty(weight.size, np.int64), np.empty(weight.size, np.int64), np.empty(weight.size), 0
    for a in range(len(weight)):
        for k in range(weight.shape[1]):
            b, both, known = chosen[a, k], weight[a, k], False
            if both <= 0:
                continue
            for m in range(weight.shape[1]):
                if chosen[b, m] == a and weight[b, m] > 0:
                    both, known = both + weight[b, m], b < a
            if not known and both > least:
                i[n], j[n], cost[n], n = min(a, b), max(a, b), both, n + 1
    return i[:n], j[:n], cost[:n]


def sheet_borders(frames: Frames, normals: Float[Array, "M 3"]) -> Borders:
    """Neighbours that lie in the same sheet, told by normals."""
    M, (near, distance) = len(frames.points), frames.surroundings
    weight, chosen = np.empty((M, KEPT)), np.empty((M, KEPT), np.int64)
    _weights(
        frames.points, normals, near, distance, DISTANCE, OFFSET, AGREEMENT, KEPT, STRENGTH, ISOLATED, weight, chosen
    )
    return Borders(*_pairs(weight, chosen, 1 / UNIT))


def expand(cost: Float[Array, "M P"], labels: Int[Array, " M"], borders: Borders, part: int) -> Int[Array, " M"]:
    """Labels after the best set of points has gone over to `part`. cost: inf where a part is out of the question."""
    free = np.flatnonzero(np.isfinite(cost[:, part]) & (labels != part))
    if len(free) == 0:
        return labels
    number = np.full(len(labels), -1)
    number[free] = np.arange(len(free))
    stay, go = cost[free, labels[free]].copy(), cost[free, part].copy()
    a, b = number[borders.i], number[borders.j]
    for one, other, fixed in ((a, b, borders.j), (b, a, borders.i)):
        edge = (one >= 0) & (other < 0)
        here, there = one[edge], labels[fixed[edge]]
        np.add.at(stay, here, borders.cost[edge] * (labels[free[here]] != there))
        np.add.at(go, here, borders.cost[edge] * (there != part))
    inner = (a >= 0) & (b >= 0)
    a, b, weight = a[inner], b[inner], borders.cost[inner]
    alike = labels[free[a]] == labels[free[b]]
    np.add.at(stay, a[~alike], weight[~alike])  # both stay, or a alone: a border; b alone is an edge from a to b
    first = np.concatenate([a[alike], b[alike], b[~alike]])
    second = np.concatenate([b[alike], a[alike], a[~alike]])
    links = (first, second, np.concatenate([weight[alike], weight[alike], weight[~alike]]))
    return np.where(_go(len(free), links, stay, go, number), part, labels)


def _go(
    n: int,
    links: tuple[Int[Array, " L"], Int[Array, " L"], Float[Array, " L"]],
    stay: Float[Array, " n"],
    go: Float[Array, " n"],
    number: Int[Array, " M"],
) -> Bool[Array, " M"]:
    """Which points go: those on the sink's side of the minimum cut. A link i -> j costs if i stays and j goes."""
    source, sink = n, n + 1
    least, every = np.minimum(stay, go), np.arange(n)
    rows = np.concatenate([links[0], np.full(n, source), every])
    columns = np.concatenate([links[1], every, np.full(n, sink)])
    capacity = np.concatenate([links[2], go - least, stay - least])
    graph = csr_matrix((np.round(UNIT * capacity).astype(np.int32), (rows, columns)), shape=(n + 2, n + 2))
    left = graph - maximum_flow(graph, source, sink).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    stays = np.zeros(n + 2, dtype=bool)
    stays[breadth_first_order(left, source, return_predecessors=False)] = True
    return (number >= 0) & ~stays[number]
