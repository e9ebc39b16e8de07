"""The geometry that the correspondence network works on: nested samples of a cloud and who neighbours whom.

It does not depend on any weight, so it is made once a cloud, outside of the network.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import farthest_points, nearest, search_tree

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

THINNING = 4  # each level has this many times fewer points than the one before
RADII = (0.16, 0.32, 0.64)  # of the neighbourhoods of each level, in root mean square radii of the cloud
NEIGHBOURS = (16, 24)  # at the near scale and at the wide one
ANCHORS = 3  # points that features are interpolated from
MIN_POINTS = THINNING ** len(RADII) * ANCHORS


@dataclass(frozen=True)
class Pyramid:
    """A cloud in farthest-point order: level l is its first `sizes[l]` points, level 0 all of them.

    points (N, 3): centred, in root mean square radii. order (N,): row of each point in the cloud it was made from.
    near, wide: for each level l > 0 the rows (N_l, K) of the neighbours of its points among the points of level l - 1
    and, at twice the radius, among those of level l itself. anchors, weights: for each level l > 0 the rows
    (N_(l-1), 3) of the points of level l from which the points of level l - 1 are interpolated, and how.
    """

    points: Array
    order: IntArray
    near: tuple[IntArray, ...]
    wide: tuple[IntArray, ...]
    anchors: tuple[IntArray, ...]
    weights: tuple[Array, ...]


def level_sizes(n: int) -> list[int]:
    """Points of every level of a cloud of n points."""
    return [n // THINNING**level for level in range(len(RADII) + 1)]


def build_pyramid(points: Array, scale: float) -> Pyramid:
    """The pyramid of a cloud (N, 3) of at least `MIN_POINTS` points, in units of `scale`.

    Both clouds of a pair take the same scale: an object does not grow when it unfolds.
    """
    sizes = level_sizes(len(points))
    first = farthest_points(points, sizes[1])  # names a point again when only copies are left
    first = first[np.sort(np.unique(first, return_index=True)[1])]
    order = np.concatenate([first, np.setdiff1d(np.arange(len(points)), first)])
    x = ((points - points.mean(axis=0)) / scale)[order]
    trees = [search_tree(x[:size]) for size in sizes]
    near, wide, anchors, weights = [], [], [], []
    for level, radius in enumerate(RADII, 1):
        centres = x[: sizes[level]]
        near.append(_ball(trees[level - 1], centres, NEIGHBOURS[0], radius))
        wide.append(_ball(trees[level], centres, NEIGHBOURS[1], 2 * radius))
        distance, rows = nearest(trees[level], x[: sizes[level - 1]], k=ANCHORS)
        weight = 1.0 / (distance + 1e-6)
        anchors.append(rows)
        weights.append((weight / weight.sum(axis=1, keepdims=True)).astype(np.float32))
    return Pyramid(x.astype(np.float32), order, tuple(near), tuple(wide), tuple(anchors), tuple(weights))


def _ball(tree, centres: Array, k: int, radius: float) -> IntArray:
    """(M, k) rows of the nearest points within a radius; the nearest of all stands in for those that are missing."""
    distance, rows = nearest(tree, centres, k=min(k, tree.n))
    return np.where(distance < radius, rows, rows[:, :1])
