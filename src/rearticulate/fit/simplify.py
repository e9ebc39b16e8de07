"""Joints that the data do not need: two parts are welded when the other joints make up for the one between them.

Fragments of a limb whose first motions were inexact end as links of their own. Whether the tree can do without a
joint is told cheaply by fitting the smaller tree to the poses of the larger one; the energy decides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rearticulate.config import ProjectConfig
from rearticulate.fit.articulated import Articulated
from rearticulate.fit.bundle import SIGMA, adjust_to_poses, bundle_adjust
from rearticulate.fit.cluster import adjacent_labels
from rearticulate.fit.energy import energy
from rearticulate.fit.frames import Frames
from rearticulate.fit.relaxed import INFORMATION_SIGMA, fuse, fused_equations, points_behind

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

TRIES = 3  # welds that are put to the test of the energy
WIDE = 10.0  # robust scale of the misfit: none


def weld(tree: Articulated, j: int, k: int) -> tuple[Articulated, IntArray]:
    """The tree with part j made one with part k (its parent or a child of the same parent), and the new number (P,) of
    every part."""
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
class Weld:
    """A smaller tree, the number (P,) every part has in it, and its misfit to the poses of the larger tree."""

    tree: Articulated
    number: IntArray
    misfit: float


def possible_welds(frames: Frames, canonical: int, tree: Articulated, labels: IntArray) -> list[Weld]:
    """The tree without one joint, for every joint, with the others adjusted to make up for it; least misfit first.

    A part joins its parent, or a part that touches it and hangs on the same parent. The misfit is a root mean square,
    in spacings, over the points of the smaller of the two.
    """
    T = tree.forward()
    H, _ = fused_equations(frames, canonical, T, fuse(frames, T, labels), INFORMATION_SIGMA, frames.stride)
    points = points_behind(H)
    rows = frames.rows(canonical)
    touching = adjacent_labels(frames.points[rows], labels[rows])
    pairs = [(j, int(tree.parent[j])) for j in range(1, tree.n_parts)]
    pairs += [(b, a) for a, b in sorted(touching) if a > 0 and tree.parent[a] == tree.parent[b]]
    out = []
    for j, k in pairs:
        smaller, number = weld(tree, j, k)
        smaller, misfit = adjust_to_poses(smaller, canonical, number, T, H, sigma=WIDE)
        few = min(points[:, j].sum(), points[:, k].sum())
        out.append(Weld(smaller, number, float(np.sqrt((misfit * points).sum() / (few + 1e-9)))))
    return sorted(out, key=lambda w: w.misfit)


def simplify(
    frames: Frames, canonical: int, tree: Articulated, labels: IntArray, config: ProjectConfig
) -> tuple[Articulated, IntArray, float]:
    """Weld joints, the least needed first, while the energy does not rise. Returns tree, labels (M,) and energy."""
    value = energy(frames, tree.forward(), labels)
    searching = tree.n_parts > 1
    while searching:
        searching = False
        likely = [w for w in possible_welds(frames, canonical, tree, labels) if w.misfit < config.weld]
        for option in likely[:TRIES]:
            merged = option.number[labels]
            smaller = bundle_adjust(frames, canonical, option.tree, merged, (SIGMA,))
            new = energy(frames, smaller.forward(), merged)
            if new < value:
                tree, labels, value = smaller, merged, new
                searching = tree.n_parts > 1
                break
    return tree, labels, value
