"""Postures for one scan from nowhere: a beam search along the tree. Each joint in turn tries a whole turn (or slide);
the best few, and different, partial postures are registered as a whole and go on to the next joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rearticulate.geometry.kinematics import depth_first, forward_kinematics
from rearticulate.geometry.nearest import nearest
from rearticulate.geometry.se3 import exp_se3, rotate, transform
from rearticulate.localization.descent import pair_weights, stepped
from rearticulate.observe.register import match, normal_equations

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

BEAM = 64  # partial postures that go on
VALUES = 60  # that every joint tries
MOST = 600  # where a link without points keeps all values
SAMPLE = 60  # points of a link that judge them
APART = 2.5  # steps between two values of a joint that are different postures
SIGMAS = (4.0, 2.0, 1.0)  # robust scales of the rounds that register partial postures, in spacings
SAME = 2.0  # spacings; postures of which no point is farther apart than this are one
CAP = 8.0  # spacings; a point that is farther off counts as this far
OUTSIDE = 0.3  # price of leaving the observed range by a radian or by its own length, in spacings
SLIDE = 1.5  # how far a slide may go beyond its range, in ranges


@dataclass(frozen=True)
class Tree:
    """parent (P,), twists (P, 6), limits (P, 2): of the joints. points, normals (n, 3), link (n,): samples of the body
    in the rest pose. share (P,): of each link in all its points."""

    parent: IntArray
    twists: Array
    limits: Array
    points: Array
    normals: Array
    link: IntArray
    share: Array

    def renumbered(self, order: IntArray) -> Tree:
        """The same with the links in another order (P,), parents before children."""
        number = np.argsort(order)
        parent, link = self.parent[order], number[self.link]
        return Tree(
            np.where(parent < 0, -1, number[parent]),
            self.twists[order],
            self.limits[order],
            self.points,
            self.normals,
            link,
            self.share[order],
        )

    def up_to(self, j: int) -> Tree:
        """The first j + 1 links."""
        own = self.link <= j
        some = slice(j + 1)
        return Tree(
            self.parent[some],
            self.twists[some],
            self.limits[some],
            self.points[own],
            self.normals[own],
            self.link[own],
            self.share[some],
        )


@dataclass(frozen=True)
class Target:
    """The scan: a search tree of its points, their normals (N, 3)."""

    tree: KDTree
    normals: Array


def sampled(points: Array, normals: Array, link: IntArray, P: int) -> tuple[Array, Array, IntArray, Array]:
    """About SAMPLE points of every one of P links, their normals, links, and the share of each link in all points."""
    own = [np.flatnonzero(link == p) for p in range(P)]
    rows = np.concatenate([row[:: max(1, len(row) // SAMPLE)] for row in own])
    return points[rows], normals[rows], link[rows], np.array([len(row) for row in own]) / len(link)


def beam_search(tree: Tree, scan: Target, roots: Array) -> tuple[Array, Array]:
    """The best postures, best first: q (B, P) and root poses (B, 4, 4), from some root poses (R, 4, 4).

    What is next to be tried is a child of what was just found, where there is one: a joint whose link has no points
    is told by the link after it, so all its values go on to that.
    """
    order = depth_first(tree.parent)
    tree = tree.renumbered(order)
    q, root = np.zeros((len(roots), len(order))), roots
    cost = _cost_so_far(tree.up_to(0), scan, q[:, :1], root)
    for j in range(1, len(order)):
        so_far, values, points = tree.up_to(j), _values(tree.twists[j], tree.limits[j]), tree.points[tree.link == j]
        if not len(points):
            b, v = _all(len(q), len(values))
            q, root, cost = q[b], root[b], cost[b]
            q[:, j] = values[v]
            continue
        base = forward_kinematics(so_far.parent, so_far.twists, q[:, : j + 1], root)[:, tree.parent[j]]
        tried = base[:, None] @ exp_se3(values[:, None] * tree.twists[j])  # (B, V, 4, 4)
        price = OUTSIDE * _outside(values, tree.limits[j], tree.twists[j])
        b, v = _different(cost[:, None] + tree.share[j] * (_cost(scan, tried, points) + price))
        q, root = q[b], root[b]
        q[:, j] = values[v]
        q[:, : j + 1], root = registered(so_far, scan, q[:, : j + 1], root)
        cost = _cost_so_far(so_far, scan, q[:, : j + 1], root)
        kept = _distinct(so_far, q[:, : j + 1], root, cost)
        q, root, cost = q[kept], root[kept], cost[kept]
    return q[:, np.argsort(order)], root


def registered(tree: Tree, scan: Target, q: Array, root: Array) -> tuple[Array, Array]:
    """Postures (B, P), (B, 4, 4) after some rounds in which the body's points look for counterparts in the scan."""
    B, P = q.shape
    body = (P * np.arange(B)[:, None] + tree.link).ravel()
    for sigma in SIGMAS:
        T = forward_kinematics(tree.parent, tree.twists, q, root)
        moved = T[:, tree.link]
        y = transform(moved, tree.points[None]).reshape(-1, 3)
        ny = rotate(moved, tree.normals[None]).reshape(-1, 3)
        z, nz, d, r, agreement = match(scan.tree, scan.normals, y, ny, CAP)
        w = np.where(np.isfinite(d), pair_weights(r, d, agreement, sigma), 0.0)
        H, g = normal_equations(y, z, nz, w, 0.1 * w, body, B * P)
        q, root = stepped(tree.parent, tree.twists, q, root, T, H.reshape(B, P, 6, 6), g.reshape(B, P, 6))
    return q, root


def _distinct(tree: Tree, q: Array, root: Array, cost: Array) -> IntArray:
    """Rows of postures that are not all but the same as a better one, best first."""
    T = forward_kinematics(tree.parent, tree.twists, q, root)
    y = transform(T[:, tree.link], tree.points[None])
    kept: list[int] = []
    for b in np.argsort(cost, kind="stable"):
        gap = np.linalg.norm(y[kept] - y[b], axis=-1)  # (kept, n)
        if not (gap.max(axis=-1) < SAME).any():
            kept.append(int(b))
    return np.array(kept)


def _values(twist: Array, limits: Array) -> Array:
    """What a joint tries: all directions of a hinge, the observed range and more of a slide."""
    if twist[:3].any():
        return np.linspace(-np.pi, np.pi, VALUES, endpoint=False)
    if not twist.any():
        return np.zeros(1)
    low, high = limits
    return np.linspace(low - SLIDE * (high - low), high + SLIDE * (high - low), VALUES)


def _outside(q: Array, limits: Array, twists: Array) -> Array:
    """How far values (..., P) are beyond the ranges (P, 2): radians, or lengths of the range of a slide."""
    beyond = np.abs(q - np.clip(q, limits[..., 0], limits[..., 1]))
    turns = twists[..., :3].any(axis=-1)
    return beyond / np.where(turns, 1.0, np.maximum(limits[..., 1] - limits[..., 0], 1.0))


def _cost_so_far(tree: Tree, scan: Target, q: Array, root: Array) -> Array:
    """(B,) cost of partial postures: mean capped distance of all points, and the price of leaving observed ranges."""
    T = forward_kinematics(tree.parent, tree.twists, q, root)
    cost = np.stack([_cost(scan, T[:, j], tree.points[tree.link == j]) for j in range(len(tree.parent))], axis=1)
    return (cost + OUTSIDE * _outside(q, tree.limits, tree.twists)) @ tree.share


def _cost(scan: Target, T: Array, points: Array) -> Array:
    """(...,) mean capped distance of a link's points (n, 3) at poses T (..., 4, 4) to the scan."""
    if not len(points):
        return np.zeros(T.shape[:-2])
    y = transform(T[..., None, :, :], points)
    d = nearest(scan.tree, y.reshape(-1, 3), within=CAP)[0]
    return np.minimum(d, CAP).reshape(y.shape[:-1]).mean(axis=-1)


def _all(B: int, V: int) -> tuple[IntArray, IntArray]:
    """Rows and columns of values APART for all rows, or for as many of the first ones as make no more than MOST."""
    columns = np.arange(0, V, int(np.ceil(APART)))
    rows = np.arange(min(B, max(1, MOST // len(columns))))
    return np.repeat(rows, len(columns)), np.tile(columns, len(rows))


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
