"""The points of all frames in the canonical pose: a part has as many points as it has in all its scans together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.records import FitResult, PointSequence

Array = NDArray[np.floating]

NEIGHBOUR = 8
STRAY = 4.0  # a stray point is this many times farther from its 8th neighbour than is usual for its part


def fuse(result: FitResult, sequence: PointSequence) -> tuple[Array, ...]:
    """One array (M_p, 3) a part, canonical coordinates, m. Points far from all others of their part, which had a wrong
    label, are left out."""
    model, motion = result.model, result.motion
    T_part_world = inverse(model.forward(motion.q, motion.T_world_root))  # (F, P, 4, 4)
    moved = [
        transform(T[labels], points)
        for T, labels, points in zip(T_part_world, result.labels, sequence.points, strict=True)
    ]
    points, labels = np.concatenate(moved), np.concatenate(result.labels)
    return tuple(without_strays(points[labels == p]) for p in range(model.n_parts))


def without_strays(points: Array) -> Array:
    """(M', 3) the points that have company."""
    if len(points) <= NEIGHBOUR:
        return points
    distance = nearest(search_tree(points), points, k=NEIGHBOUR + 1)[0][:, -1]
    return points[distance <= STRAY * np.median(distance)]
