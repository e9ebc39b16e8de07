"""How far points, carried by a part, land from other frames, whatever lies there, and how far they would by chance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform_by
from rearticulate.observe.frames import Frames

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


def evidence_frames(F: int, limit: int) -> list[int]:
    """At most `limit` of F frames, evenly spread."""
    return [int(f) for f in np.linspace(0, F - 1, min(F, limit)).round()]


def sampling_distance(frames: Frames) -> Array:
    """(F,) what `frame_residual` of an exact model would be, in spacings: mean distance of one random half of a frame's
    points to the other, which has half the density; distances in a surface go with its inverse square root."""
    rng, out = np.random.default_rng(0), np.zeros(frames.n_frames)
    for f in range(frames.n_frames):
        points = rng.permutation(frames.points[frames.rows(f)])
        half = len(points) // 2
        out[f] = nearest(search_tree(points[:half]), points[half:])[0].mean() / np.sqrt(2)
    return out


def frame_residual(frames: Frames, canonical: int, T: Array, labels: IntArray) -> Array:
    """(F,) mean distance of the moved canonical points to each frame, in spacings."""
    rows = frames.rows(canonical)
    out = np.zeros(frames.n_frames)
    for f in range(frames.n_frames):
        out[f] = nearest(frames.trees[f], transform_by(T[f], labels[rows], frames.points[rows]))[0].mean()
    return out
