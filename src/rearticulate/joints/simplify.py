"""Joints that the data do not need are fixed: two parts become one where the other joints make up for theirs.

Fragments of a limb whose first motions were inexact end as links of their own. Whether the tree can do without a
joint is told cheaply by fitting the smaller tree to the poses of the larger one; the energy decides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.bundle import SIGMA, adjust_to_poses, bundle_adjust
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import INFORMATION_SIGMA, points_behind
from rearticulate.parts.bodies import Bodies, Explanation, bodies_equations, explanation, labels_of, poses
from rearticulate.parts.cluster import adjacent_labels
from rearticulate.progress import Told, steps, untold

ROUNDS = 10  # each of which tries all joints that are left
LIKELY = 1.0  # spacings; a joint that the others make up for to this misfit is put to the test of the energy
TRIES = 3  # fixed joints that fail the test of the energy in one round
WIDE = 10.0  # robust scale of the misfit: none


def fix_joint(tree: Articulated, j: int, k: int) -> tuple[Articulated, Int[Array, " P"]]:
    """The tree with parts j and k made one, and the new number of every part.

    One of them is the other's parent, or both hang on the same part.
    """
    if tree.parent[k] == j:
        j, k = k, j
    parent = np.where(tree.parent == j, k, tree.parent)
    order, queue = [], [0]
    while queue:
        order.append(queue.pop(0))
        queue += [int(c) for c in np.flatnonzero(parent == order[-1]) if c != j]
    keep = np.array(order)
    number = np.empty(tree.n_parts, dtype=np.int64)
    number[keep] = np.arange(len(keep))
    number[j] = number[k]
    smaller = replace(
        tree,
        parent=np.where(parent[keep] < 0, -1, number[parent[keep]]),
        twist=tree.twist[keep],
        revolute=tree.revolute[keep],
        q=tree.q[:, keep],
    )
    return smaller, number


@dataclass(frozen=True)
class Poses:
    """What a smaller tree must reach: the part poses T of a tree and their information H."""

    T: Float[Array, "F P 4 4"]
    H: Float[Array, "F P 6 6"]


@dataclass(frozen=True)
class FixedJoint:
    """Part j made one with part k: the smaller tree, the number every part has in it, and its misfit.

    The misfit to the poses of the larger tree is a root mean square, in spacings, over the points of the smaller part.
    """

    j: int
    k: int
    tree: Articulated
    number: Int[Array, " P"]
    misfit: float


def poses_of(bodies: Bodies) -> Poses:
    return Poses(poses(bodies), bodies_equations(bodies, INFORMATION_SIGMA)[0])


def try_fixing(canonical: int, tree: Articulated, reached: Poses, j: int, k: int) -> FixedJoint:
    """The tree without the joint between j and k, with the others adjusted to make up for it."""
    smaller, number = fix_joint(tree, j, k)
    smaller, misfit = adjust_to_poses(smaller, canonical, number, reached.T, reached.H, sigma=WIDE)
    points = points_behind(reached.H)
    few = min(points[:, j].sum(), points[:, k].sum())
    return FixedJoint(j, k, smaller, number, float(np.sqrt((misfit * points).sum() / (few + 1e-9))))


def possible_fixes(
    frames: Frames, canonical: int, tree: Articulated, labels: Int[Array, " M"], reached: Poses, told: Told = untold
) -> list[FixedJoint]:
    """One for every joint, least misfit first: a part joins its parent, or a part that touches it and hangs on the same
    parent."""
    rows = frames.rows(canonical)
    touching = adjacent_labels(frames.points[rows], labels[rows])
    pairs = [(j, int(tree.parent[j])) for j in range(1, tree.n_parts)]
    pairs += [(b, a) for a, b in sorted(touching) if a > 0 and tree.parent[a] == tree.parent[b]]
    fixes = []
    for j, k in pairs:
        fixes.append(try_fixing(canonical, tree, reached, j, k))
        told(len(fixes) / len(pairs))
    return sorted(fixes, key=lambda fix: fix.misfit)


def simplify(
    frames: Frames, canonical: int, tree: Articulated, bodies: Bodies, told: Told = untold
) -> tuple[Articulated, Bodies, Explanation]:
    """Fix joints, the least needed first, while the score does not rise. Returns tree, bodies and what
    their score is made of."""
    value, reached, labels = explanation(frames, bodies), poses_of(bodies), labels_of(bodies, len(frames.points))
    count = tree.n_parts + 1
    for each_round in steps(told, ROUNDS):
        if not 1 < tree.n_parts < count:
            break
        count = tree.n_parts
        fixes = possible_fixes(frames, canonical, tree, labels, reached, each_round)
        likely = [fix for fix in fixes if fix.misfit < LIKELY]
        now, failures = np.arange(tree.n_parts), 0  # now: the number of each part after what was fixed in this round
        for found in likely:
            j, k = int(now[found.j]), int(now[found.k])
            if j == k:
                continue
            option = found if tree.n_parts == count else try_fixing(canonical, tree, reached, j, k)
            if option.misfit >= LIKELY:
                continue
            merged = option.number[labels]
            before = tuple(bodies[k] for k in np.unique(option.number, return_index=True)[1])
            smaller, fewer = bundle_adjust(frames, canonical, option.tree, merged, (SIGMA,), before)
            new = explanation(frames, fewer)
            if new.over(value) < 0:
                tree, bodies, labels, value, now = smaller, fewer, merged, new, option.number[now]
                reached = poses_of(bodies)
            elif (failures := failures + 1) == TRIES:
                break
    return tree, bodies, value
