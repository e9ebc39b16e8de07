"""Is every frame as large as the canonical one? States that are reconstructed one by one often are not.

Rigid parts cannot follow a scale: a body that grows falls into pieces that drift apart, by joints that do not exist.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3, inverse, rotate, transform
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import FUSED_REACH, apart

STEPS = 30
SETTLED = 1e-4  # a step that scales by less is the last
DRIFT = 0.012  # clean recordings seem to drift by up to 0.011, sparse ones most
SURE = 3.0  # standard deviations
BIAS = 0.05  # spacings: deviation of a registration at the object's radius that no number of points brings down
LEAST = 0.004  # a scale nearer to one has no consequences
KNOWN = 0.02  # a part whose own scale is less certain has no say
NOISE = 0.56  # robust scale of the registration, in spacings
RIDGE = 1e-3  # keeps what a part does not show near its start


@dataclass(frozen=True)
class Scales:
    """size: how many times as large as the canonical frame each frame is. std: its standard deviation."""

    size: Float[Array, " F"]
    std: Float[Array, " F"]

    @property
    def differ(self) -> Bool[Array, " F"]:
        """The frames that are surely of another size; none where all are alike to what clean recordings are."""
        surely = np.abs(self.size - 1) > np.maximum(SURE * self.std, LEAST)
        return surely & (np.ptp(np.where(surely, self.size, 1.0)) > DRIFT)

    @property
    def drift(self) -> float:
        """Largest difference in size between two frames; 0 where none surely differs."""
        return float(np.ptp(np.where(self.differ, self.size, 1.0)))


def frame_scales(frames: Frames, canonical: int, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"]) -> Scales:
    """Register every part of every frame to its canonical points by a similarity; the scale of a frame is the median
    of those of its parts, weighted by what they know, and its deviation how far the parts agree.

    T and labels of all points: the start. A part is scaled about its middle, so it does not matter where its joints let
    it stand.
    """
    F, P = T.shape[:2]
    rows = np.arange(0, len(labels), frames.stride)
    body = frames.frame[rows] * P + labels[rows]
    order = np.argsort(body, kind="stable")
    rows, (body, start, owner) = rows[order], np.unique(body[order], return_index=True, return_inverse=True)
    back = inverse(T)[frames.frame[rows], labels[rows]]
    y, normals = transform(back, frames.points[rows]), rotate(back, frames.normals[rows])
    middle = (np.add.reduceat(y, start) / np.diff([*start, len(rows)])[:, None])[owner]
    still = frames.rows(canonical)
    tree = search_tree(apart(frames.points[still], labels[still]))
    grown = np.zeros(len(body))  # logarithm of what brings each body to its canonical size
    for _ in range(STEPS):
        d, j = nearest(tree, apart(y, labels[rows]))
        n = _mean_normals(frames.normals[still][j], normals)
        r = np.einsum("ij,ij->i", y - frames.points[still][j], n)
        step, information = _similarities(y - middle, n, r, (d < FUSED_REACH) * geman_mcclure(r * r, NOISE), start)
        turn = exp_se3(step[:, :6])[owner]
        y = middle + np.exp(step[owner, 6:]) * transform(turn, y - middle)
        normals = rotate(turn, normals)
        grown += step[:, 6]
        if np.abs(step[:, 6]).max() < SETTLED:
            break
    moving = body // P != canonical
    noise = max(1.48 * float(np.median(np.abs(r[moving[owner]]))), 1e-6) if moving.any() else 1.0
    found = _median_of_bodies(F, body[moving] // P, np.exp(-grown[moving]), noise / np.sqrt(information[moving]))
    radius = float(np.sqrt(frames.points[still].var(axis=0).sum()))
    return Scales(found.size, np.maximum(found.std, BIAS / radius))


def _mean_normals(a: Float[Array, "n 3"], b: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Mean directions of normals of any sign. On a round surface the plane of one point lies outside, and every
    cloud would seem to be smaller than the one that it is compared with."""
    mean = a + b * np.where(np.einsum("ij,ij->i", a, b) < 0, -1.0, 1.0)[:, None]
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def _similarities(
    arm: Float[Array, "n 3"],
    n: Float[Array, "n 3"],
    r: Float[Array, " n"],
    w: Float[Array, " n"],
    start: Int[Array, " B"],
) -> tuple[Float[Array, "B 7"], Float[Array, " B"]]:
    """Gauss-Newton step of twists and log scales of bodies, and the information about their scales.

    arm: points from the middle of their body, normals n, residuals r, weights w. start: first row of each body.
    """
    J = np.concatenate([np.cross(arm, n), n, np.einsum("ij,ij->i", arm, n)[:, None]], axis=1)
    H = np.add.reduceat(J[:, :, None] * (w[:, None] * J)[:, None], start) + RIDGE * np.eye(7)
    g = np.add.reduceat(J * (w * r)[:, None], start)
    return -np.linalg.solve(H, g[..., None])[..., 0], 1 / np.linalg.inv(H)[:, 6, 6]


def _median_of_bodies(F: int, frame: Int[Array, " B"], size: Float[Array, " B"], std: Float[Array, " B"]) -> Scales:
    """Weighted median of the sizes of each frame's bodies; 1, and surely so, where there are none."""
    median, deviation = np.ones(F), np.zeros(F)
    for f in range(F):
        told = (frame == f) & (std < KNOWN)
        if told.any():
            x, w = size[told], 1 / std[told] ** 2
            median[f] = _weighted_median(x, w)
            spread = 1.48 * float(np.median(np.abs(x - median[f]))) / np.sqrt(len(x))
            deviation[f] = max(spread, 1 / np.sqrt(w.sum()))
    return Scales(median, deviation)


def _weighted_median(x: Float[Array, " n"], w: Float[Array, " n"]) -> float:
    order = np.argsort(x, kind="stable")
    share = np.cumsum(w[order])
    return float(x[order[np.searchsorted(share, share[-1] / 2)]])
