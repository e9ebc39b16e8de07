"""Can a sequence be fitted at all? Every rule is relative to the object's own size: no unit is assumed."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.errors import InputError, InputWarning
from rearticulate.io.sensors import check_sensors
from rearticulate.records import Array, IntArray, PointSequence

MIN_FRAMES = 2
MIN_POINTS = 100
FLAT = 5e-3  # a smaller standard deviation across than along (a sheet, a line) counts as none
STRAY = 0.05  # a smaller share of the points is stray, not an object
_CELLS = 12  # a gap wider than the object itself is wider than a quarter of all, so coarse cells find it
_MAX_CLUSTERS = 16


def check_sequence(sequence: PointSequence) -> None:
    """An InputError where no kinematic model can be told from the sequence; an InputWarning for stray points."""
    if len(sequence) < MIN_FRAMES:
        raise InputError(f"{len(sequence)} frame(s): motion needs at least {MIN_FRAMES} frames of the same object")
    for name, points in zip(sequence.names, sequence.points, strict=True):
        check_frame(name, points)
    check_sensors(sequence.origins, sequence.sensor, [len(points) for points in sequence.points])
    splits = [split_far_apart(points) for points in sequence.points]
    _check_one_object(sequence.names, splits)
    _check_spread(sequence, splits)


def check_frame(name: str, points: Array) -> None:
    """An InputError where one cloud is none, whatever the others are."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{name}: one frame has the shape (N, 3), this is {points.shape}")
    if len(points) < MIN_POINTS:
        raise InputError(f"{name}: {len(points)} point(s), a frame needs at least {MIN_POINTS} different ones")
    if not np.isfinite(points).all():
        raise InputError(f"{name}: some coordinates are not finite numbers")
    if not np.ptp(points, axis=0).any():
        raise InputError(f"{name}: all {len(points)} points are the same point")


def _check_spread(sequence: PointSequence, splits: list[Split]) -> None:
    """Stray points apart, no frame may be a line; a sheet in every frame leaves the motion open."""
    flat = []
    for name, points, split in zip(sequence.names, sequence.points, splits, strict=True):
        spread = spread_of(points[~split.stray])
        if spread[1] <= FLAT * spread[0]:
            raise InputError(f"{name}: the points lie on a line; a frame must show the surface of an object")
        flat.append(spread[2] <= FLAT * spread[0])
    if all(flat):
        raise InputError("every frame is flat; points of one plane do not fix a motion in space, give a solid object")


def spread_of(points: Array) -> Array:
    """(3,) standard deviations along the principal axes, largest first. points: (N, 3)."""
    centred = points - points.mean(axis=0)
    size = np.abs(centred).max() or 1.0
    variance = np.linalg.eigvalsh(np.cov((centred / size).T))[::-1]
    return size * np.sqrt(np.maximum(variance, 0))


def _check_one_object(names: tuple[str, ...], splits: list[Split]) -> None:
    if all(len(split.objects) > 1 for split in splits):
        n, gap = max(len(split.objects) for split in splits), min(split.gap for split in splits)
        raise InputError(f"the frames hold {n} separate objects {gap:.3g} m apart; crop the frames to one object")
    stray = [(name, split) for name, split in zip(names, splits, strict=True) if split.stray.any()]
    if stray:
        name, split = stray[0]
        more = f" and in {len(stray) - 1} more frame(s)" if len(stray) > 1 else ""
        text = f"{split.stray.sum()} stray point(s) {split.gap:.3g} m away from the object in {name}{more}; crop them"
        warnings.warn(text, InputWarning, stacklevel=4)


@dataclass(frozen=True)
class Split:
    """A cloud in pieces that are further apart than any of the objects is wide.

    objects: how many points each piece has, the largest first, without pieces below the stray share.
    stray: (N,) the points of those. gap: smallest distance between two pieces, m; 0 where the cloud is one piece.
    """

    objects: tuple[int, ...]
    stray: NDArray[np.bool_]
    gap: float


def split_far_apart(points: Array) -> Split:
    """Far pieces of (N, 3) points. Stray points are set apart first: a very far one hides all that is nearer."""
    split = _finest_split(points)
    if len(split.objects) > 1 or not split.stray.any():
        return split
    inner = split_far_apart(points[~split.stray])
    stray = split.stray.copy()
    stray[~split.stray] = inner.stray
    return Split(inner.objects, stray, inner.gap or split.gap)


def _finest_split(points: Array) -> Split:
    """The finest single-linkage split of (N, 3) points whose gaps all exceed the diameter of every object in it."""
    from scipy.cluster.hierarchy import fcluster, linkage

    low, high, box = _boxes(points)
    count = np.bincount(box)
    if len(count) > 1:  # one box: all points are equal
        tree = linkage(_box_distances(low, high), "single")
        for k in range(min(_MAX_CLUSTERS, len(count)), 1, -1):
            gap = float(tree[-(k - 1), 2])
            cluster = fcluster(tree, k, "maxclust")
            sizes = np.bincount(cluster, count).astype(int)
            big = np.flatnonzero(sizes >= STRAY * len(points))
            diameter = [np.linalg.norm(high[cluster == c].max(0) - low[cluster == c].min(0)) for c in big]
            if len(big) and gap > max(diameter):
                return Split(tuple(sorted(sizes[big], reverse=True)), ~np.isin(cluster[box], big), gap)
    return Split((len(points),), np.zeros(len(points), dtype=bool), 0.0)


def _boxes(points: Array) -> tuple[Array, Array, IntArray]:
    """Occupied cells of a coarse grid: bounding box of the points in each (C, 3), (C, 3), cell of each point (N,)."""
    start, size = points.min(axis=0), np.ptp(points, axis=0).max()
    cell = np.minimum((points - start) / (size or 1.0) * _CELLS, _CELLS - 1).astype(np.int64)
    _, box = np.unique(cell @ np.array([_CELLS * _CELLS, _CELLS, 1]), return_inverse=True)
    order = np.argsort(box, kind="stable")
    first = np.flatnonzero(np.diff(box[order], prepend=-1))
    return np.minimum.reduceat(points[order], first), np.maximum.reduceat(points[order], first), box


def _box_distances(low: Array, high: Array) -> Array:
    """Condensed distances between boxes (C, 3), (C, 3): never more than between the points in them."""
    a, b = np.triu_indices(len(low), 1)
    apart = np.maximum(np.maximum(low[a] - high[b], low[b] - high[a]), 0)
    return np.linalg.norm(apart, axis=1)
