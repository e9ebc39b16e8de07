"""Observed scene flow between two neighbouring frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float
from rearticulate.geometry.nearest import nearest, search_tree

TOUCHING = 1e-9  # share of the largest distance to an anchor at which a point counts as lying on it


@dataclass(frozen=True)
class SceneFlow:
    """Where points of frame f are in frame f + 1: anchors in frame f, vectors from there. Any unit."""

    anchors: Float[Array, "A 3"]
    vectors: Float[Array, "A 3"]

    def interpolate(self, queries: Float[Array, "n 3"], k: int = 3) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
        """Flow at points and the distance of the nearest anchor (infinite where there is none).

        Mean of the k nearest anchors, weighted by their inverse distance (paper, sec. 3.2, "flow energy term").
        """
        k = min(k, len(self.anchors))
        if k == 0:
            return np.zeros_like(queries), np.full(len(queries), np.inf)
        distance, row = nearest(search_tree(self.anchors), queries, k=k)
        distance, row = distance.reshape(-1, k), row.reshape(-1, k)
        return weigh(distance, self.vectors[row]), distance[:, 0]


def weigh(distance: Float[Array, "n k"], vectors: Float[Array, "n k 3"]) -> Float[Array, "n 3"]:
    """Mean of vectors, weighted by the inverse of distance; finite on an anchor."""
    weight = 1.0 / np.maximum(distance, TOUCHING * distance.max(initial=0.0) + np.finfo(distance.dtype).tiny)
    return np.einsum("nk,nkc->nc", weight / weight.sum(axis=1, keepdims=True), vectors)
