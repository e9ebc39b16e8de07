"""The fused cloud: the points of all frames, carried back to the canonical frame by the parts they belong to.

Every frame is registered against it, and it tells how noisy the surfaces are and what a pose is known to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import adjoint, inverse, transform_by
from rearticulate.observe.frames import Frames, smallest_direction
from rearticulate.observe.register import normal_equations

FUSED_REACH = 2.8  # spacings within which a point has a counterpart in the fused cloud
APART = 1e4  # distance that `apart` puts between the clouds of different parts
INFORMATION_SIGMA = 0.56  # robust scale at which the information of a pose is taken


def to_canonical(frames: Frames, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"]) -> Float[Array, "M 3"]:
    """Every point of every frame carried back to the canonical frame by its part."""
    return transform_by(inverse(T), (frames.frame, labels), frames.points)


def apart(z: Float[Array, "n 3"], label: Int[Array, " n"]) -> Float[Array, "n 3"]:
    """Points shifted by their part, so that one tree searches within one part at a time."""
    return z + np.outer(label, [APART, 0.0, 0.0])


@dataclass(frozen=True)
class Fused:
    """All frames' points in the canonical frame, searchable within one part at a time.

    surface: rows of an even sample of them, with normals; tree over the sample `apart`.
    """

    z: Float[Array, "M 3"]
    labels: Int[Array, " M"]
    frame: Int[Array, " M"]
    surface: Int[Array, " K"]
    normals: Float[Array, "K 3"]
    tree: KDTree

    def nearest_of_other_frames(
        self, y: Float[Array, "n 3"], label: Int[Array, " n"], frame: Int[Array, " n"], k: int = 4
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, " n"]]:
        """Nearest surface point z of the same part that comes from another frame, its normal and the distance (inf if
        there is none)."""
        d, j = nearest(self.tree, apart(y, label), k=k)
        j = np.minimum(j, len(self.surface) - 1)
        d = np.where((self.frame[self.surface[j]] == frame[:, None]) | (d > APART / 2), np.inf, d)
        rows = np.arange(len(y))
        best = d.argmin(axis=1)
        j, d = j[rows, best], d[rows, best]
        return self.z[self.surface[j]], self.normals[j], d


def fuse(frames: Frames, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"], neighbours: int = 16) -> Fused:
    """Bring all points to the canonical frame; normals from the fused cloud of each part."""
    z = to_canonical(frames, T, labels)
    surface = np.arange(0, len(z), frames.stride)
    keyed = apart(z[surface], labels[surface])
    tree = search_tree(keyed)
    d, j = nearest(tree, keyed, k=min(neighbours, len(keyed)))
    j = np.where(d < APART / 2, j, j[:, :1])
    return Fused(z, labels, frames.frame, surface, smallest_direction(z[surface], j), tree)


def match_fused(
    frames: Frames, canonical: int, T: Float[Array, "F P 4 4"], fused: Fused, stride: int = 1
) -> tuple[Int[Array, " n"], Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, " n"]]:
    """Every stride-th point of the other frames that has a counterpart: its row, itself y in the canonical frame, the
    nearest fused point z of its part from another frame, the normal there, and the distance."""
    rows = np.flatnonzero(frames.frame != canonical)[::stride]
    labels, frame = fused.labels[rows], frames.frame[rows]
    y = transform_by(inverse(T), (frame, labels), frames.points[rows])
    z, n, d = fused.nearest_of_other_frames(y, labels, frame)
    found = d < FUSED_REACH
    return rows[found], y[found], z[found], n[found], d[found]


def surface_noise(frames: Frames, canonical: int, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"]) -> float:
    """Robust deviation of the points from the surface of their part that the other frames' points make, in spacings."""
    fused = fuse(frames, T, labels)
    _, y, z, n, _ = match_fused(frames, canonical, T, fused, frames.stride)
    return 1.48 * float(np.median(np.abs(np.einsum("ij,ij->i", y - z, n)))) if len(y) else 0.0


def fused_equations(
    frames: Frames, canonical: int, T: Float[Array, "F P 4 4"], fused: Fused, sigma: float, stride: int = 1
) -> tuple[Float[Array, "F P 6 6"], Float[Array, "F P 6"]]:
    """Normal equations H, g of the left twists of T from frame points against the fused cloud.

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


def points_behind(H: Float[Array, "*batch 6 6"]) -> Float[Array, "*batch"]:
    """Weight of the points in information matrices H: each adds 1 across its plane, 0.03 along each of three axes,
    about 1.1 in all, to the trace of the translations."""
    return np.trace(H[..., 3:, 3:], axis1=-2, axis2=-1) / 1.1
