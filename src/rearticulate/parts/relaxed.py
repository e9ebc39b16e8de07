"""The relaxed model: rigid parts that move freely, and the part of every point of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import exp_se3, transform, transform_by
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import fuse, fused_equations
from rearticulate.observe.register import CONVERGED, Schedule, register_bodies, solve_twists
from rearticulate.progress import Told, untold


@dataclass(frozen=True)
class Relaxed:
    """T: T_frame_canonical of each part, identity at the canonical frame. labels: part of a point.

    found: how many parts `relax` saw at first, those included that were too many to be worked with.
    """

    T: Float[Array, "F P 4 4"]
    labels: Int[Array, " M"]
    found: int = 0

    @property
    def n_parts(self) -> int:
        return self.T.shape[1]

    def counts(self) -> Float[Array, " P"]:
        """Mean number of points a frame."""
        return np.bincount(self.labels, minlength=self.n_parts) / len(self.T)

    def moved_points(self, frames: Frames, canonical: int) -> Float[Array, "F N 3"]:
        """Canonical points moved to every frame."""
        rows = frames.rows(canonical)
        return transform(self.T[:, self.labels[rows]], frames.points[rows])


def spread_labels(
    frames: Frames, canonical: int, T: Float[Array, "F P 4 4"], labels: Int[Array, " N"]
) -> Int[Array, " M"]:
    """Labels of the canonical points -> labels of all points, by the nearest moved canonical point."""
    rows = frames.rows(canonical)
    out = np.empty(len(frames.points), dtype=np.int64)
    for f in range(frames.n_frames):
        moved = transform_by(T[f], labels, frames.points[rows])
        out[frames.rows(f)] = labels[nearest(search_tree(moved), frames.points[frames.rows(f)])[1]]
    out[rows] = labels
    return out


def keep_parts(frames: Frames, model: Relaxed, keep: Int[Array, " K"]) -> Relaxed:
    """Only these parts, renumbered; points of the others go to the part of the nearest kept point of their frame."""
    number = np.full(model.n_parts, -1)
    number[keep] = np.arange(len(keep))
    labels = number[model.labels]
    for f in range(frames.n_frames):
        rows = frames.rows(f)
        lost = labels[rows] < 0
        if lost.any():
            points, kept = frames.points[rows], labels[rows][~lost]
            if len(kept) == 0:
                labels[rows] = 0
                continue
            labels[rows] = np.where(lost, kept[nearest(search_tree(points[~lost]), points)[1]], labels[rows])
    return Relaxed(model.T[:, keep], labels)


def merge_pair(
    frames: Frames, model: Relaxed, a: int, b: int, counts: Float[Array, " P"] | Int[Array, " P"]
) -> Relaxed:
    """Make parts a and b one, with the motion of the one that has more of the points, counts (P,)."""
    keep, lose = sorted((a, b), key=lambda p: -counts[p])
    labels = np.where(model.labels == lose, keep, model.labels)
    return keep_parts(frames, Relaxed(model.T, labels), np.delete(np.arange(model.n_parts), lose))


def largest_parts(frames: Frames, model: Relaxed, count: int) -> Relaxed:
    """At most so many parts: the smaller ones are dissolved."""
    if model.n_parts <= count:
        return model
    return keep_parts(frames, model, np.sort(np.argsort(-model.counts(), kind="stable")[:count]))


def register_to_frames(
    frames: Frames, canonical: int, model: Relaxed, schedule: Schedule, told: Told = untold
) -> Relaxed:
    """Register the canonical points of every part to every frame."""
    rows = frames.rows(canonical)
    x, nx, labels = frames.points[rows], frames.normals[rows], model.labels[rows]
    T = model.T.copy()
    for f in range(frames.n_frames):
        if f != canonical:
            T[f] = register_bodies(frames.trees[f], frames.normals[frames.rows(f)], x, nx, labels, T[f], schedule)
        told((f + 1) / frames.n_frames)
    return Relaxed(T, model.labels)


def register_to_fused(frames: Frames, canonical: int, model: Relaxed, sigma: float = 0.56, inner: int = 5) -> Relaxed:
    """Register every frame's points of a part to the dense cloud of that part made of the other frames."""
    fused = fuse(frames, model.T, model.labels)
    T = model.T.copy()
    moving = np.arange(len(T)) != canonical
    for _ in range(inner):
        H, g = fused_equations(frames, canonical, T, fused, sigma, frames.stride)
        step = solve_twists(H, g)[moving]
        T[moving] = exp_se3(step) @ T[moving]
        if np.abs(step[..., 3:]).max() < CONVERGED:
            break
    return Relaxed(T, model.labels)
