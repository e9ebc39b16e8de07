"""Points that are no points: broken coordinates, what sensors write where they saw nothing, doubles, and surplus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.records import Array, IntArray

_FAR = 1e30  # sensors mark missing points with huge numbers; no coordinate in any unit is as large
_OFTEN = 0.01  # what is repeated as often as this share of the points, and much oftener than others, was not measured
_OFTENER = 20

BROKEN = "points with NaN, infinite or absurd coordinates dropped"
MISSING = "points dropped that all lie at one place, as sensors write what they did not see"
DOUBLE = "points that repeat another point dropped"
SURPLUS = "points left out at random to keep {max_points} a frame"


@dataclass(frozen=True)
class Cleaned:
    """points (M, 3), their rows (M,) in the source, how many were dropped by what they were."""

    points: Array
    rows: IntArray
    dropped: dict[str, int]

    def without_origin(self) -> Cleaned:
        """Without points at exactly (0, 0, 0), which other frames have shown to be missing ones."""
        keep = self.points.any(axis=1)
        dropped = {**self.dropped, MISSING: self.dropped[MISSING] + int((~keep).sum())}
        return Cleaned(self.points[keep], self.rows[keep], dropped)


def clean(raw: NDArray[np.generic], max_points: int, rng: np.random.Generator) -> tuple[Cleaned, bool]:
    """The points of a frame (N, 3) that are some, at most max_points, and whether missing ones lay at the origin."""
    sound = np.isfinite(raw).all(axis=1) & (np.abs(raw) < _FAR).all(axis=1)
    row = np.flatnonzero(sound)
    points = np.asarray(raw[row], dtype=np.float64) + 0.0  # -0.0 and 0.0 are one number
    first, count = _places(points)
    at_origin = ~points[first].any(axis=1)
    often = count >= max(_OFTEN * len(points), _OFTENER * np.median(count) if len(count) else 0)
    missing = (often & (not often.all())) | (at_origin & (count > 1))
    places = first[~missing]
    surplus = max(len(places) - max_points, 0)
    kept = np.sort(rng.choice(places, max_points, replace=False)) if surplus else places
    dropped = {
        BROKEN: len(raw) - len(row),
        MISSING: int(count[missing].sum()),
        DOUBLE: int((count[~missing] - 1).sum()),
        SURPLUS: surplus,
    }
    return Cleaned(points[kept], row[kept], dropped), bool((missing & at_origin).any())


def _places(points: Array) -> tuple[IntArray, IntArray]:
    """Rows of (N, 3) points that have no equal before them (M,), ascending, and how often each occurs (M,).

    Sorts one hash a row: ten million take seconds.
    """
    bits = np.ascontiguousarray(points).view(np.uint64)
    odd: NDArray[np.uint64] = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    hashed = ((bits ^ (bits >> np.uint64(29))) * odd).sum(axis=1)
    order = np.argsort(hashed, kind="stable")
    same = np.zeros(len(points), dtype=bool)  # as the one before it in this order
    near = np.flatnonzero(hashed[order[1:]] == hashed[order[:-1]]) + 1
    same[near] = (points[order[near]] == points[order[near - 1]]).all(axis=1)
    start = np.flatnonzero(~same)
    first, count = order[start], np.diff(np.append(start, len(points)))
    ascending = np.argsort(first)
    return first[ascending], count[ascending]
