"""Regions of a body that may be a second one: where they are, and motions of their own that explain them better.

A region is registered to the body's points of every frame, from where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import farthest_points, nearest, search_tree
from rearticulate.geometry.se3 import transform_by
from rearticulate.observe.body import Body
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import Schedule, fit_cost, register_bodies

PER_REGION, REGIONS = 50, (4, 14)  # canonical points of a body for each region that is tried, and how many
SHARE, SIZES = 0.2, (30, 120)  # of a body's canonical points in a region, and how many
REGION = Schedule(iterations=8, sigma=1.5, sigma_end=0.3)
SEEN = 8  # points of a frame of a body, at least


@dataclass(frozen=True)
class Proposal:
    """Canonical points rows (n,) of a body, by their number in it, a motion T of their own, and by how much it lowers
    the misfit of one of them."""

    rows: Int[Array, " n"]
    T: Float[Array, "F 4 4"]
    gain: float


def regions_of(body: Body, canonical: int) -> Int[Array, "R n"]:
    """Canonical points of a body around places far from each other; none where it has too few."""
    here = np.flatnonzero(body.frame == canonical)
    if len(here) < 2 * SIZES[0]:
        return np.zeros((0, 0), dtype=np.int64)
    size = int(np.clip(SHARE * len(here), *SIZES))
    seeds = body.z[here][farthest_points(body.z[here], int(np.clip(len(here) / PER_REGION, *REGIONS)))]
    return here[nearest(search_tree(body.z[here]), seeds, k=size)[1]]


def registered(frames: Frames, canonical: int, body: Body, regions: Int[Array, "R n"]) -> list[Proposal]:
    """Every region with the motion that registers it to the body's points of every frame."""
    R, F = len(regions), frames.n_frames
    D, gain = np.tile(np.eye(4), (R, F, 1, 1)), np.zeros(R)
    points, owner = regions.ravel(), np.repeat(np.arange(R), regions.shape[1])
    x, nx = body.z[points], body.normals[points]
    for f in range(F):
        there = np.flatnonzero(body.frame == f)
        if f == canonical or len(there) < SEEN or R == 0:
            continue
        tree, normals = search_tree(body.z[there]), body.normals[there]
        D[:, f] = register_bodies(tree, normals, x, nx, owner, D[:, f], REGION)
        y = transform_by(D[:, f], owner, x)
        gain += (fit_cost(tree, normals, x, nx) - fit_cost(tree, normals, y, nx)).reshape(R, -1).mean(axis=1)
    return [Proposal(regions[r], body.T @ D[r], gain[r] / (F - 1)) for r in range(R)]
