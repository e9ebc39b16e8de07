"""The relaxed model: rigid parts that move freely, and the part of every point of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, transform
from rearticulate.solver.frames import Frames, smallest_direction
from rearticulate.solver.progress import Told, untold
from rearticulate.solver.register import Schedule, geman_mcclure, normal_equations, register_bodies, solve_twists

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

CONVERGED = 5e-3  # a step that moves less than this many spacings is the last
FUSED_REACH = 2.8  # spacings within which a point has a counterpart in the fused cloud
APART = 1e4  # distance that `apart` puts between the clouds of different parts
INFORMATION_SIGMA = 0.56  # robust scale at which the information of a pose is taken


@dataclass(frozen=True)
class Relaxed:
    """T (F, P, 4, 4): T_frame_canonical of each part, identity at the canonical frame. labels (M,): part of a point.

    found: how many parts `relax` saw at first, those included that were too many to be worked with.
    """

    T: Array
    labels: IntArray
    found: int = 0

    @property
    def n_parts(self) -> int:
        return self.T.shape[1]

    def counts(self) -> Array:
        """(P,) mean number of points a frame."""
        return np.bincount(self.labels, minlength=self.n_parts) / len(self.T)

    def moved_points(self, frames: Frames, canonical: int) -> Array:
        """(F, N, 3) canonical points moved to every frame."""
        rows = frames.rows(canonical)
        return transform(self.T[:, self.labels[rows]], frames.points[rows])


def to_canonical(frames: Frames, T: Array, labels: IntArray) -> Array:
    """(M, 3) every point of every frame carried back to the canonical frame by its part."""
    return transform(inverse(T)[frames.frame, labels], frames.points)


def spread_labels(frames: Frames, canonical: int, T: Array, labels: IntArray) -> IntArray:
    """Labels (N,) of the canonical points -> labels (M,) of all points, by the nearest moved canonical point."""
    rows = frames.rows(canonical)
    out = np.empty(len(frames.points), dtype=np.int64)
    for f in range(frames.n_frames):
        moved = transform(T[f, labels], frames.points[rows])
        out[frames.rows(f)] = labels[nearest(search_tree(moved), frames.points[frames.rows(f)])[1]]
    out[rows] = labels
    return out


def keep_parts(frames: Frames, model: Relaxed, keep: IntArray) -> Relaxed:
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


def merge_pair(frames: Frames, model: Relaxed, a: int, b: int, counts: Array | IntArray) -> Relaxed:
    """Make parts a and b one, with the motion of the one that has more of the points, counts (P,)."""
    keep, lose = sorted((a, b), key=lambda p: -counts[p])
    labels = np.where(model.labels == lose, keep, model.labels)
    return keep_parts(frames, Relaxed(model.T, labels), np.delete(np.arange(model.n_parts), lose))


def drop_small(frames: Frames, model: Relaxed, minimum: float) -> Relaxed:
    """Dissolve parts with fewer than `minimum` points a frame (the largest part always stays)."""
    counts = model.counts()
    keep = np.flatnonzero((counts >= minimum) | (np.arange(model.n_parts) == counts.argmax()))
    return model if len(keep) == model.n_parts else keep_parts(frames, model, keep)


def largest_parts(frames: Frames, model: Relaxed, count: int) -> Relaxed:
    """At most so many parts: the smaller ones are dissolved."""
    if model.n_parts <= count:
        return model
    return keep_parts(frames, model, np.sort(np.argsort(-model.counts(), kind="stable")[:count]))


def apart(z: Array, label: IntArray) -> Array:
    """(n, 3) points shifted by their part, so that one tree searches within one part at a time."""
    return z + np.outer(label, [APART, 0.0, 0.0])


@dataclass(frozen=True)
class Fused:
    """All frames' points in the canonical frame, searchable within one part at a time.

    z (M, 3), labels (M,), frame (M,). surface (K,): rows of an even sample of them, with normals (K, 3); tree over
    the sample `apart`.
    """

    z: Array
    labels: IntArray
    frame: IntArray
    surface: IntArray
    normals: Array
    tree: KDTree

    def nearest_of_other_frames(
        self, y: Array, label: IntArray, frame: IntArray, k: int = 4
    ) -> tuple[Array, Array, Array]:
        """Nearest surface point z (n, 3) of the same part that comes from another frame, its normal and the distance
        (inf if there is none)."""
        d, j = nearest(self.tree, apart(y, label), k=k)
        j = np.minimum(j, len(self.surface) - 1)
        d = np.where((self.frame[self.surface[j]] == frame[:, None]) | (d > APART / 2), np.inf, d)
        rows = np.arange(len(y))
        best = d.argmin(axis=1)
        j, d = j[rows, best], d[rows, best]
        return self.z[self.surface[j]], self.normals[j], d


def fuse(frames: Frames, T: Array, labels: IntArray, neighbours: int = 16, dense: bool = False) -> Fused:
    """Bring all points to the canonical frame; normals from the fused cloud of each part. dense: no sample."""
    z = to_canonical(frames, T, labels)
    surface = np.arange(0, len(z), 1 if dense else frames.stride)
    keyed = apart(z[surface], labels[surface])
    tree = search_tree(keyed)
    d, j = nearest(tree, keyed, k=min(neighbours, len(keyed)))
    j = np.where(d < APART / 2, j, j[:, :1])
    return Fused(z, labels, frames.frame, surface, smallest_direction(z[surface], j), tree)


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


def match_fused(
    frames: Frames, canonical: int, T: Array, fused: Fused, stride: int = 1
) -> tuple[IntArray, Array, Array, Array, Array]:
    """Every stride-th point of the other frames that has a counterpart: its row, itself y in the canonical frame, the
    nearest fused point z of its part from another frame, the normal there, and the distance."""
    rows = np.flatnonzero(frames.frame != canonical)[::stride]
    labels, frame = fused.labels[rows], frames.frame[rows]
    y = transform(inverse(T)[frame, labels], frames.points[rows])
    z, n, d = fused.nearest_of_other_frames(y, labels, frame)
    found = d < FUSED_REACH
    return rows[found], y[found], z[found], n[found], d[found]


def surface_noise(frames: Frames, canonical: int, T: Array, labels: IntArray) -> float:
    """Robust deviation of the points from the surface of their part that the other frames' points make, in spacings."""
    fused = fuse(frames, T, labels)
    _, y, z, n, _ = match_fused(frames, canonical, T, fused, frames.stride)
    return 1.48 * float(np.median(np.abs(np.einsum("ij,ij->i", y - z, n)))) if len(y) else 0.0


def fused_equations(
    frames: Frames, canonical: int, T: Array, fused: Fused, sigma: float, stride: int = 1
) -> tuple[Array, Array]:
    """Normal equations H (F, P, 6, 6), g (F, P, 6) of the left twists of T from frame points against the fused cloud.

    The residual lives in the canonical frame; a left twist of inv(T) there is -inv(T) (twist) T here. With a stride
    only every stride-th point is asked, and counts for as many.
    """
    F, P = T.shape[:2]
    rows, y, z, n, d = match_fused(frames, canonical, T, fused, stride)
    r = np.einsum("ij,ij->i", y - z, n)
    w = stride * geman_mcclure(r * r + 0.1 * d * d, sigma)
    H, g = normal_equations(y, z, n, w, 0.03 * w, frames.frame[rows] * P + fused.labels[rows], F * P)
    A = adjoint(inverse(T).reshape(-1, 4, 4))
    A_t = np.swapaxes(A, -1, -2)
    return (A_t @ H @ A).reshape(F, P, 6, 6), -(A_t @ g[..., None])[..., 0].reshape(F, P, 6)


def points_behind(H: Array) -> Array:
    """(...) weight of the points in information matrices H (..., 6, 6): each adds 1 across its plane, 0.03 along each
    of three axes, about 1.1 in all, to the trace of the translations."""
    return np.trace(H[..., 3:, 3:], axis1=-2, axis2=-1) / 1.1


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
