"""Postures for one scan from nowhere: a beam search along the tree. Each joint in turn tries a whole turn (or slide);
the best few, and different, partial postures go on to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rearticulate.geometry.nearest import nearest
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.pose.retarget import best_joint_value

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

BEAM = 24  # partial postures that go on
VALUES = 60  # that every joint tries
SAMPLE = 60  # points of a link that judge them
APART = 2.5  # steps between two values of a joint that are different postures
POLISH = 3  # rounds of nearest neighbours and the best value for them
CAP = 8.0  # spacings; a point that is farther off counts as this far
OUTSIDE = 0.3  # price of leaving the observed range by a radian or by its own length, in spacings
SLIDE = 0.5  # how far a slide may go beyond its range, in ranges


@dataclass(frozen=True)
class Tree:
    """parent (P,), twists (P, 6), limits (P, 2): of the joints; points: one (n, 3) array a link, in the rest pose."""

    parent: IntArray
    twists: Array
    limits: Array
    points: tuple[Array, ...]


def beam_search(tree: Tree, scan: KDTree, roots: Array) -> tuple[Array, Array]:
    """The best postures, best first: q (B, P) and root poses (B, 4, 4), from some root poses (R, 4, 4)."""
    P = len(tree.parent)
    share = np.array([len(points) for points in tree.points]) / max(1, sum(map(len, tree.points)))
    q = np.zeros((len(roots), P))
    T = np.tile(roots[:, None], (1, P, 1, 1))
    cost = share[0] * _cost(scan, T[:, 0], _sample(tree.points[0]))
    for j in range(1, P):
        points, values = _sample(tree.points[j]), _values(tree.twists[j], tree.limits[j])
        base = T[:, tree.parent[j]]
        moved = base[:, None] @ exp_se3(values[:, None] * tree.twists[j])  # (B, V, 4, 4)
        price = OUTSIDE * _outside(values, tree.limits[j])
        total = cost[:, None] + share[j] * (_cost(scan, moved, points) + price)
        b, v = _different(total)
        q, T, base, cost = q[b], T[b], base[b], cost[b]
        q[:, j] = polished(scan, tree.twists[j], base, points, values[v])
        T[:, j] = base @ exp_se3(q[:, j, None] * tree.twists[j])
        cost = cost + share[j] * (_cost(scan, T[:, j], points) + OUTSIDE * _outside(q[:, j], tree.limits[j]))
    order = np.argsort(cost, kind="stable")
    return q[order], T[order, 0]


def _sample(points: Array) -> Array:
    return points[:: max(1, len(points) // SAMPLE)]


def _values(twist: Array, limits: Array) -> Array:
    """What a joint tries: all directions of a hinge, the observed range and more of a slide."""
    if twist[:3].any():
        return np.linspace(-np.pi, np.pi, VALUES, endpoint=False)
    if not twist.any():
        return np.zeros(1)
    low, high = limits
    return np.linspace(low - SLIDE * (high - low), high + SLIDE * (high - low), VALUES)


def _outside(q: Array, limits: Array) -> Array:
    return np.abs(q - np.clip(q, *limits))


def _cost(scan: KDTree, T: Array, points: Array) -> Array:
    """(...,) mean capped distance of a link's points (n, 3) at poses T (..., 4, 4) to the scan."""
    if not len(points):
        return np.zeros(T.shape[:-2])
    y = transform(T[..., None, :, :], points)
    d = nearest(scan, y.reshape(-1, 3), within=CAP)[0]
    return np.minimum(d, CAP).reshape(y.shape[:-1]).mean(axis=-1)


def _different(total: Array) -> tuple[IntArray, IntArray]:
    """Rows and columns of the BEAM lowest costs (B, V), columns of one row APART."""
    taken: list[tuple[int, int]] = []
    V = total.shape[1]
    for flat in np.argsort(total, axis=None, kind="stable"):
        b, v = divmod(int(flat), V)
        if all(b != c or min(abs(v - w), V - abs(v - w)) >= APART for c, w in taken):
            taken.append((b, v))
            if len(taken) == BEAM:
                break
    chosen = np.array(taken)
    return chosen[:, 0], chosen[:, 1]


def polished(scan: KDTree, twist: Array, base: Array, points: Array, q: Array) -> Array:
    """(B,) joint values after some rounds of nearest neighbours. base (B, 4, 4): poses of the parent."""
    if not len(points) or not twist.any():
        return q
    for _ in range(POLISH):
        y = transform((base @ exp_se3(q[:, None] * twist))[:, None], points)
        d, row = nearest(scan, y.reshape(-1, 3), within=CAP)
        found = np.isfinite(d).reshape(y.shape[:-1])
        z = scan.data[np.where(np.isfinite(d), row, 0)].reshape(y.shape)
        seen = transform(inverse(base)[:, None], z)
        value = best_joint_value(twist, points, seen, found)
        q = np.where(found.any(axis=1), value, q)
    return q
