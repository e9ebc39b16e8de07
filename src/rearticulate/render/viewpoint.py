"""From where an object shows most of its parts."""

from __future__ import annotations

import numpy as np

from rearticulate.geometry.thin import thinned
from rearticulate.records import Array, FitResult, IntArray, PointSequence
from rearticulate.render.camera import View

STEP = 15  # degrees
FIRST = 35  # wins where all are equal
CELLS = 40  # a side of the coarse picture in which a point hides what is behind it
BUDGET = 3000
FRAMES = 3
BEHIND = 0.1  # as far behind the nearest point of its cell, in radii of the picture, a point is hidden


def best_view(result: FitResult, sequence: PointSequence, elevation: float = 15.0, up: str = "z") -> View:
    """The direction all around from which every part shows as much of itself as possible, in a few frames.

    The score of a direction is the sum over parts of the square root of the share of their points that is seen."""
    frames = np.unique(np.linspace(0, len(sequence) - 1, FRAMES).round().astype(int))
    views = [View(float(FIRST + turn), elevation, up) for turn in range(0, 360, STEP)]
    scores = [sum(shown(view, sequence.points[f], result.labels[f]) for f in frames) for view in views]
    return views[int(np.argmax(np.round(scores, 6)))]


def shown(view: View, points: Array, labels: IntArray) -> float:
    """The score of one cloud (N, 3)."""
    rows = thinned(len(points), BUDGET)
    at, depth = view.camera([points], (CELLS, CELLS)).project(points[rows])
    cell = np.clip(at, 0, CELLS - 1).astype(int) @ np.array([1, CELLS])
    front = np.full(CELLS * CELLS, -np.inf)
    np.maximum.at(front, cell, depth)
    seen = depth > front[cell] - BEHIND
    parts = labels[rows]
    counts = np.maximum(np.bincount(parts), 1)
    return float(np.sqrt(np.bincount(parts, weights=seen) / counts).sum())
