"""Kinematic trees under construction: the root, the spanning tree of pairwise costs, the numbering of the parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from rearticulate.arrays import Array, Float, Int
from rearticulate.joints.articulated import Articulated
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import Relaxed

STILL = 1.0  # spacings; mean motion below which a part stands still


@dataclass(frozen=True)
class Projection:
    """A tree and labels to start from.

    Hidden links get their first points from the part that hangs on them, few or many: a large link with few points
    loses them all while the joints of its chain are biased by the points it lacks; a small one with too many follows
    the wrong part. Both are starts. hidden: numbers of these links.
    """

    tree: Articulated
    starts: tuple[Int[Array, " M"], ...]
    hidden: Int[Array, " n"]


def choose_root(frames: Frames, canonical: int, model: Relaxed) -> int:
    """The largest of the parts that stand still; of all parts where none does."""
    rows = frames.rows(canonical)
    labels = model.labels[rows]
    travel = np.linalg.norm(model.moved_points(frames, canonical) - frames.points[rows], axis=-1).mean(axis=0)
    size = np.bincount(labels, minlength=model.n_parts)
    mean = np.bincount(labels, travel, minlength=model.n_parts) / np.maximum(size, 1)
    still = (size > 0) & (mean < STILL)
    return int(np.where(still | ~still.any(), model.counts(), -1).argmax())


def spanning_tree(cost: Float[Array, "P P"], root: int) -> tuple[Int[Array, " P"], Int[Array, " P"]]:
    """Minimum spanning tree of a full cost matrix: parents and the parts in breadth-first order."""
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
    twist: Float[Array, " 6"]
    q: Float[Array, " F"]
    revolute: bool


def number_parts(parent: dict[int, int], root: int, P: int) -> tuple[Int[Array, " P"], Int[Array, " P"]]:
    """Number the parts parents first, breadth first. parent: of every part but the root, by their old numbers.

    Returns the new number of every old part and the parents by new numbers.
    """
    number, order = np.full(P, -1), [root]
    for new, part in enumerate(order):  # which grows meanwhile
        number[part] = new
        order += sorted(child for child, above in parent.items() if above == part)
    return number, np.array([-1] + [int(number[parent[part]]) for part in order[1:]])


def assemble(
    links: list[Link], T_root: Float[Array, "F 4 4"], root: int, P: int
) -> tuple[Articulated, Int[Array, " P"]]:
    """The tree of the links, parents first. Returns it and the new number of every old part."""
    number, parent = number_parts({link.child: link.parent for link in links}, root, P)
    twist, revolute, q = np.zeros((P, 6)), np.ones(P, dtype=bool), np.zeros((len(T_root), P))
    for link in links:
        j = number[link.child]
        twist[j], revolute[j], q[:, j] = link.twist, link.revolute, link.q
    return Articulated(parent, twist, revolute, q, T_root.copy()), number
