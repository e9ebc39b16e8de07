"""What the registration knows about the motions of the parts: the evidence for and against joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float
from rearticulate.geometry.nearest import contact, nearest
from rearticulate.geometry.se3 import transform_by
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import INFORMATION_SIGMA, Fused, fuse, points_behind
from rearticulate.observe.views import Views
from rearticulate.parts.bodies import bodies_equations, make_bodies
from rearticulate.parts.relaxed import Relaxed

NOISE_FLOOR = 0.25  # spacings; registration is never trusted to better than this


def free_share(frames: int, joints: int) -> float:
    """Share of the relative motions of two parts, 6 numbers a frame, that joints in series, 4 numbers for an axis and a
    value a frame, leave to be contradicted."""
    return 1 - joints * (3 + frames) / (6 * (frames - 1))


@dataclass(frozen=True)
class Evidence:
    """What the registration knows: information H of every pose, plane noise sigma, the fused cloud, what every frame's
    sensors see, where it is known."""

    T: Float[Array, "F P 4 4"]
    H: Float[Array, "F P 6 6"]
    sigma: float
    fused: Fused
    canonical: int
    views: Views | None = None

    def reduced(self, cost: Float[Array, " B"], joints: int = 0) -> Float[Array, " B"]:
        """Cost of so many joints in series -> chi-square per degree of freedom; inf where they can explain anything.

        The thresholds hold for ten frames; with fewer there is less to contradict a chain.
        """
        left = free_share(len(self.T), joints)
        if left <= 0:
            return np.full_like(cost, np.inf)
        return cost / self.sigma**2 / (6 * (len(self.T) - 1)) * free_share(10, joints) / left

    def rms(self, cost: Float[Array, " B"], W: Float[Array, "B F 6 6"]) -> Float[Array, " B"]:
        """Cost -> root mean square misfit of a point, in spacings."""
        return np.sqrt(cost / (points_behind(W).sum(-1) + 1e-9))


def plane_noise(frames: Frames, canonical: int, model: Relaxed) -> float:
    """Robust deviation of the canonical points from the surfaces of the neighbouring frames, at least NOISE_FLOOR."""
    rows = frames.rows(canonical)
    labels = model.labels[rows]
    residuals = []
    for f in (canonical - 1, canonical + 1):
        if 0 <= f < frames.n_frames:
            y = transform_by(model.T[f], labels, frames.points[rows])
            j = nearest(frames.trees[f], y)[1]
            residuals.append(
                np.abs(np.einsum("ij,ij->i", y - frames.trees[f].data[j], frames.normals[frames.rows(f)][j]))
            )
    return max(1.48 * float(np.median(np.concatenate(residuals))), NOISE_FLOOR)


def gather_evidence(frames: Frames, canonical: int, model: Relaxed) -> Evidence:
    fused = fuse(frames, model.T, model.labels)
    H, _ = bodies_equations(make_bodies(frames, model.T, model.labels), INFORMATION_SIGMA)
    return Evidence(model.T, H, plane_noise(frames, canonical, model), fused, canonical, frames.views)


def contact_point(evidence: Evidence, a: int, b: int, n: int = 40) -> Float[Array, " 3"]:
    """Middle of the nearest fused points of two parts."""
    za, zb = (evidence.fused.z[evidence.fused.labels == p] for p in (a, b))
    return contact(za, zb, n)
