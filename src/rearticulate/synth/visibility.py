"""Which points of a cloud a camera sees, without a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


def visible_points(points: Array, direction: Array, *, sharpness: float = 2.0) -> IntArray:
    """Rows of `points` (N, 3) that a camera looking from `direction` (3,) sees, in increasing order.

    Hidden point removal (Katz, Tal & Basri 2007): points are flipped outwards over a sphere about the camera, of
    10 ** sharpness times the cloud's extent; those on the convex hull of the result are visible. The camera stands
    three radii away from the middle of the cloud. At the default sharpness and 24,000 points some 80 to 86 % of what
    a ray test sees is kept, and 2 % of what is kept is hidden; a sparser cloud lets more of its back shine through.
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = np.linalg.norm(points - middle, axis=1).max()
    seen = points - (middle + 3 * radius * direction / np.linalg.norm(direction))
    distance = np.linalg.norm(seen, axis=1, keepdims=True)
    flipped = seen + 2 * (10**sharpness * distance.max() - distance) * seen / distance
    hull = ConvexHull(np.concatenate([flipped, np.zeros((1, 3))]))
    return np.sort(hull.vertices[hull.vertices < len(points)]).astype(np.int64)
