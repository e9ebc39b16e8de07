"""Where the measured points support a fitted model, and where they do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.geometry.thin import thinned
from rearticulate.posing.fuse import fuse
from rearticulate.records import Array, FitResult, IntArray, PointSequence

BUDGET = 4000  # points of the model
NEAR = 3.0  # a measured point within so many distances between measured points supports the model there


@dataclass(frozen=True)
class Support:
    """points (N, 3): of the model in the canonical frame, from all frames. labels (N,). distance (F, N): from each, as
    posed in a frame, to the nearest measured point, m. spacing (F,): how far apart measured points are, m."""

    points: Array
    labels: IntArray
    distance: Array
    spacing: Array

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(F, N) whether a point of the model was measured in a frame."""
        return self.distance < NEAR * self.spacing[:, None]

    def misfit(self) -> Array:
        """(N,) mean distance over the frames that measured about there, m; where none did, over all."""
        counts = self.seen.sum(axis=0)
        own = np.where(self.seen, self.distance, 0.0).sum(axis=0) / np.maximum(counts, 1)
        return np.where(counts > 0, own, self.distance.mean(axis=0))

    def of_frames(self) -> Array:
        """(F,) share of the model that each frame shows."""
        return self.seen.mean(axis=1)

    def of_parts(self, n_parts: int) -> Array:
        """(F, P) share of each part that each frame shows; 1 for parts without points."""
        out = np.ones((len(self.seen), n_parts))
        for p in range(n_parts):
            if (self.labels == p).any():
                out[:, p] = self.seen[:, self.labels == p].mean(axis=1)
        return out


def support(result: FitResult, sequence: PointSequence) -> Support:
    """Of a fit by the points it was made from."""
    clouds = fuse(result, sequence)
    points, labels = np.concatenate(clouds), np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    rows = thinned(len(points), BUDGET)
    points, labels = points[rows], labels[rows]
    T = result.model.forward(result.motion.q, result.motion.T_world_root)
    distance, spacing = [], []
    for measured, pose in zip(sequence.points, T, strict=True):
        tree = search_tree(measured)
        distance.append(nearest(tree, transform(pose[labels], points))[0])
        some = measured[thinned(len(measured), 500)]
        spacing.append(float(np.median(nearest(tree, some, k=2)[0][:, 1])))
    return Support(points, labels, np.array(distance), np.array(spacing))
