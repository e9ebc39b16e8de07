"""The label-free energy of a fit: how badly the points, carried by their own part, land on the other frames, and what
the description of the parts costs: their number and the length of their borders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.observe.frames import Frames

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

PER_JOINT = 0.002  # what a joint must earn: an empty joint must not win by chance
PER_EMPTY = 0.004  # ... and a link without points: the border it saves must not pay for it
EMPTY = 5.0  # points a frame that a link shows at least
PER_BORDER = 0.2  # a patch that slides in itself fits two parts: it must not go to the one it fits better by chance
EVIDENCE_FRAMES = 12  # that a point is tested against, at most
SAME_SURFACE = 0.8  # neighbours that lie farther than this from a point's tangent plane are of another surface


def evidence_frames(F: int, limit: int = EVIDENCE_FRAMES) -> list[int]:
    """At most `limit` frames, evenly spread: the ones every point is tested against."""
    return [int(f) for f in np.linspace(0, F - 1, min(F, limit)).round()]


def point_misfit(
    frames: Frames, T: Array, labels: IntArray, rows: IntArray | None = None, targets: list[int] | None = None
) -> Array:
    """(n,) mean over the target frames of a point's capped distance and plane distance, in spacings.

    rows (n,): the points that are asked, all by default; labels (n,): theirs.
    """
    rows = np.arange(len(frames.points)) if rows is None else rows
    targets = evidence_frames(frames.n_frames) if targets is None else targets
    frame = frames.frame[rows]
    z = transform(inverse(T)[frame, labels], frames.points[rows])
    total, count = np.zeros(len(z)), np.zeros(len(z))
    for f in targets:
        away = np.flatnonzero(frame != f)
        y = transform(T[f, labels[away]], z[away])
        d, j = nearest(frames.trees[f], y)
        r = np.abs(np.einsum("ij,ij->i", y - frames.trees[f].data[j], frames.normals[frames.rows(f)][j]))
        total[away] += np.minimum(d, 1.6) + 0.25 * np.minimum(r / 0.28, 3.0)
        count[away] += 1
    return total / np.maximum(count, 1)


def border_length(frames: Frames, labels: IntArray) -> float:
    """Mean share of a point's nearest neighbours in the same surface that belong to another part."""
    near, here = frames.neighbours[:, :8], frames.offsets[:, :8] < SAME_SURFACE
    other = (labels[near] != labels[:, None]) & here
    return float((other.sum(axis=1) / np.maximum(here.sum(axis=1), 1)).mean())


def energy(frames: Frames, T: Array, labels: IntArray) -> float:
    """Mean misfit over every second point of all frames, plus the prices of joints and borders."""
    rows = np.arange(0, len(labels), 2)
    misfit = float(point_misfit(frames, T, labels[rows], rows).mean())
    P = T.shape[1]
    empty = int((np.bincount(labels, minlength=P) < EMPTY * frames.n_frames).sum())
    return misfit + PER_JOINT * (P - 1) + PER_EMPTY * empty + PER_BORDER * border_length(frames, labels)


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
        out[f] = nearest(frames.trees[f], transform(T[f, labels[rows]], frames.points[rows]))[0].mean()
    return out
