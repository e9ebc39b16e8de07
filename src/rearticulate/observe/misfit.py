"""How badly points, carried by a part, land on the other frames, whatever lies there."""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform_by
from rearticulate.observe.frames import Frames

EVIDENCE_FRAMES = 12  # that a point is tested against, at most


def evidence_frames(F: int, limit: int = EVIDENCE_FRAMES) -> list[int]:
    """At most `limit` frames, evenly spread: the ones every point is tested against."""
    return [int(f) for f in np.linspace(0, F - 1, min(F, limit)).round()]


def point_misfit(
    frames: Frames,
    T: Float[Array, "F P 4 4"],
    labels: Int[Array, " n"],
    rows: Int[Array, " n"] | None = None,
    targets: list[int] | None = None,
) -> Float[Array, " n"]:
    """Mean over the target frames of a point's capped distance and plane distance, in spacings.

    rows: the points that are asked, all by default; labels: theirs.
    """
    rows = np.arange(len(frames.points)) if rows is None else rows
    targets = evidence_frames(frames.n_frames) if targets is None else targets
    frame = frames.frame[rows]
    z = transform_by(inverse(T), (frame, labels), frames.points[rows])
    total, count = np.zeros(len(z)), np.zeros(len(z))
    for f in targets:
        away = np.flatnonzero(frame != f)
        y = transform_by(T[f], labels[away], z[away])
        d, j = nearest(frames.trees[f], y)
        r = np.abs(np.einsum("ij,ij->i", y - frames.trees[f].data[j], frames.normals[frames.rows(f)][j]))
        total[away] += np.minimum(d, 1.6) + 0.25 * np.minimum(r / 0.28, 3.0)
        count[away] += 1
    return total / np.maximum(count, 1)


def sampling_distance(frames: Frames) -> Float[Array, " F"]:
    """What `frame_residual` of an exact model would be, in spacings: mean distance of one random half of a frame's
    points to the other, which has half the density; distances in a surface go with its inverse square root."""
    rng, out = np.random.default_rng(0), np.zeros(frames.n_frames)
    for f in range(frames.n_frames):
        points = rng.permutation(frames.points[frames.rows(f)])
        half = len(points) // 2
        out[f] = nearest(search_tree(points[:half]), points[half:])[0].mean() / np.sqrt(2)
    return out


def frame_residual(
    frames: Frames, canonical: int, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"]
) -> Float[Array, " F"]:
    """Mean distance of the moved canonical points to each frame, in spacings."""
    rows = frames.rows(canonical)
    out = np.zeros(frames.n_frames)
    for f in range(frames.n_frames):
        out[f] = nearest(frames.trees[f], transform_by(T[f], labels[rows], frames.points[rows]))[0].mean()
    return out
