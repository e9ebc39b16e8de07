"""Kinematic trees under construction: the root, the spanning tree of pairwise costs, the numbering of the parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from rearticulate.config import ProjectConfig
from rearticulate.fit.articulated import Articulated
from rearticulate.fit.frames import Frames
from rearticulate.fit.relaxed import Relaxed

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


@dataclass(frozen=True)
class Projection:
    """A tree and labels (M,) to start from.

    Hidden links get their first points from the part that hangs on them, few or many: a large link with few points
    loses them all while the joints of its chain are biased by the points it lacks; a small one with too many follows
    the wrong part. Both are starts. hidden: numbers of these links.
    """

    tree: Articulated
    starts: tuple[IntArray, ...]
    hidden: IntArray


def choose_root(frames: Frames, canonical: int, model: Relaxed, config: ProjectConfig) -> int:
    """The largest part among those whose own points move little more than the least moving part's."""
    rows = frames.rows(canonical)
    labels = model.labels[rows]
    travel = np.linalg.norm(model.moved_points(frames, canonical) - frames.points[rows], axis=-1).mean(axis=0)
    size = np.bincount(labels, minlength=model.n_parts)
    mean = np.bincount(labels, travel, minlength=model.n_parts) / np.maximum(size, 1)
    mean[size == 0] = np.inf
    still = mean <= config.root_motion * mean.min() + 0.5
    return int(np.where(still, model.counts(), -1).argmax())


def spanning_tree(cost: Array, root: int) -> tuple[IntArray, IntArray]:
    """Minimum spanning tree of a full cost matrix: parents (P,) and the parts in breadth-first order."""
    P = len(cost)
    if P == 1:
        return np.array([-1]), np.array([0])
    i, j = np.nonzero(np.tril(np.ones((P, P)), -1))
    positive = cost[i, j] - cost.min() + 1.0  # the sparse graph drops zero costs
    tree = minimum_spanning_tree(coo_matrix((positive, (i, j)), shape=(P, P)))
    order, parent = breadth_first_order(tree, root, directed=False)
    return np.where(parent < 0, -1, parent).astype(np.int64), order.astype(np.int64)


@dataclass
class Link:
    """A joint of the tree under construction: part `child` hangs on `parent`."""

    child: int
    parent: int
    twist: Array
    q: Array
    revolute: bool


def assemble(links: list[Link], T_root: Array, root: int, P: int) -> tuple[Articulated, IntArray]:
    """Number the parts parents first. Returns the tree and the new number of every old part."""
    by_parent: dict[int, list[Link]] = {}
    for link in links:
        by_parent.setdefault(link.parent, []).append(link)
    number, queue, F = np.full(P, -1), [root], len(T_root)
    parent, revolute = [-1], [True]
    twist: list[Array] = [np.zeros(6)]
    q: list[Array] = [np.zeros(F)]
    number[root] = 0
    while queue:
        for link in sorted(by_parent.get(queue[0], []), key=lambda k: k.child):
            number[link.child] = len(parent)
            parent.append(int(number[link.parent]))
            twist.append(link.twist)
            revolute.append(link.revolute)
            q.append(link.q)
            queue.append(link.child)
        queue.pop(0)
    return Articulated(
        np.array(parent), np.array(twist), np.array(revolute), np.stack(q, axis=1), T_root.copy()
    ), number
