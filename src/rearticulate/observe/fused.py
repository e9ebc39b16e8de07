"""The fused cloud: the points of all frames, carried back to the canonical frame by the parts they belong to.

Every frame is registered against it, and it tells how noisy the surfaces are and what a pose is known to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import adjoint, inverse, transform_by
from rearticulate.observe.frames import Frames, smallest_direction
from rearticulate.observe.register import normal_equations

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

FUSED_REACH = 2.8  # spacings within which a point has a counterpart in the fused cloud
APART = 1e4  # distance that `apart` puts between the clouds of different parts
INFORMATION_SIGMA = 0.56  # robust scale at which the information of a pose is taken


def to_canonical(frames: Frames, T: Array, labels: IntArray) -> Array:
    """(M, 3) every point of every frame carried back to the canonical frame by its part."""
    return transform_by(inverse(T), (frames.frame, labels), frames.points)


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


def fuse(frames: Frames, T: Array, labels: IntArray, neighbours: int = 16) -> Fused:
    """Bring all points to the canonical frame; normals from the fused cloud of each part."""
    z = to_canonical(frames, T, labels)
    surface = np.arange(0, len(z), frames.stride)
    keyed = apart(z[surface], labels[surface])
    tree = search_tree(keyed)
    d, j = nearest(tree, keyed, k=min(neighbours, len(keyed)))
    j = np.where(d < APART / 2, j, j[:, :1])
    return Fused(z, labels, frames.frame, surface, smallest_direction(z[surface], j), tree)


def match_fused(
    frames: Frames, canonical: int, T: Array, fused: Fused, stride: int = 1
) -> tuple[IntArray, Array, Array, Array, Array]:
    """Every stride-th point of the other frames that has a counterpart: its row, itself y in the canonical frame, the
    nearest fused point z of its part from another frame, the normal there, and the distance."""
    rows = np.flatnonzero(frames.frame != canonical)[::stride]
    labels, frame = fused.labels[rows], frames.frame[rows]
    y = transform_by(inverse(T), (frame, labels), frames.points[rows])
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
