"""The part at rest, which a body of revolution that turns on it hides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from rearticulate.geometry.nearest import nearest
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import Relaxed, spread_labels
from rearticulate.parts.trial import Trials

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

MOTION = 1.0  # spacings; only when every part moves more than this ...
MINIMUM_PART = 40  # ... that has more points than this
EXCESS = 0.05  # spacings; standing still may cost a point this much more
MINIMUM_POINTS = 60  # of the part at rest
CARRIED = 3.0  # spacings; its points must have been carried farther than this


def part_at_rest(frames: Frames, canonical: int, model: Relaxed) -> Relaxed:
    """When every part moves, the points that standing still explains as well become a part of their own.

    A body of revolution that carries a turning link is dragged along by it, for nothing in its motion says otherwise.
    """
    trials = Trials(frames, canonical, np.random.default_rng(0))
    labels = model.labels[frames.rows(canonical)]
    travel = np.linalg.norm(model.moved_points(frames, canonical) - trials.x, axis=-1).mean(axis=0)
    counts = np.bincount(labels, minlength=model.n_parts)
    mean = np.bincount(labels, travel, minlength=model.n_parts) / np.maximum(counts, 1)
    if mean[counts > MINIMUM_PART].min(initial=np.inf) < MOTION:
        return model
    everyone, still = np.arange(len(labels)), np.eye(4)[None]
    excess = np.mean(
        [
            trials.cost(f, everyone, np.zeros_like(labels), still) - trials.cost(f, everyone, labels, model.T[f])
            for f in trials.others
        ],
        axis=0,
    )
    tree = frames.trees[canonical]
    calm = excess[nearest(tree, tree.data, k=min(30, tree.n))[1]].mean(axis=1) < EXCESS
    chosen = largest_region(trials.x, trials.near[:, :8], calm)
    if chosen.sum() < MINIMUM_POINTS or travel[chosen].mean() < CARRIED:
        return model
    T = np.concatenate([model.T, np.tile(np.eye(4), (len(model.T), 1, 1, 1))], axis=1)
    labels = np.where(chosen, model.n_parts, labels)
    return Relaxed(T, spread_labels(frames, canonical, T, labels))


def largest_region(points: Array, near: IntArray, inside: NDArray[np.bool_], reach: float = 4.0) -> NDArray[np.bool_]:
    """(N,) the largest connected set of the points inside (N,): neighbours near (N, K) within reach are connected."""
    gap = np.linalg.norm(points[near] - points[:, None], axis=-1)
    a, k = np.nonzero(inside[:, None] & inside[near] & (gap < reach))
    graph = coo_matrix((np.ones(len(a)), (a, near[a, k])), shape=(len(points), len(points)))
    region = connected_components(graph, directed=False)[1]
    return inside & (region == np.bincount(region[inside], minlength=1).argmax())
