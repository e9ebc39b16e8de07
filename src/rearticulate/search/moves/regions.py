"""Regions of a body that may be a second one: where they are, and motions of their own that explain them better.

A region is registered to the body's points of every frame, from where it is. A wall that slides in itself is caught
there by its neighbours; so regions are swept as well, along the direction in which the body moves against another one,
or of which its points say little, and their ends tell how far they went.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import farthest_points, nearest, search_tree
from rearticulate.geometry.se3 import exp_se3, inverse, log_se3, transform
from rearticulate.observe.body import Body, pair_equations, partners
from rearticulate.observe.frames import Frames
from rearticulate.observe.misfit import evidence_frames
from rearticulate.observe.register import Schedule, fit_cost, register_bodies
from rearticulate.search.moves.sweep import weak_directions

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

PER_REGION, REGIONS = 50, (4, 14)  # canonical points of a body for each region that is tried, and how many
SHARE, SIZES = 0.2, (30, 120)  # of a body's canonical points in a region, and how many
ASKED = 40  # points of a region that is swept
FEW = 3  # frames that tell which regions a sweep helps
PROMISE = 0.3  # fall of a point's misfit by a sweep that is worth a try
REGION = Schedule(iterations=8, sigma=1.5, sigma_end=0.3)
SEEN = 8  # points of a frame of a body, at least
SIGMA = 0.5
STEP, MOST = 0.7, 40  # spacings; steps to each side
BEYOND = 1.5  # times as far as the body moved against the other
DIRECTIONS = 2  # of which the points say little, at most


@dataclass(frozen=True)
class Proposal:
    """Canonical points rows (n,) of a body, by their number in it, a motion T (F, 4, 4) of their own, and by how much
    it lowers the misfit of one of them."""

    rows: IntArray
    T: Array
    gain: float


def regions_of(body: Body, canonical: int) -> IntArray:
    """(R, n) canonical points of a body around places far from each other; none where it has too few."""
    here = np.flatnonzero(body.frame == canonical)
    if len(here) < 2 * SIZES[0]:
        return np.zeros((0, 0), dtype=np.int64)
    size = int(np.clip(SHARE * len(here), *SIZES))
    seeds = body.z[here][farthest_points(body.z[here], int(np.clip(len(here) / PER_REGION, *REGIONS)))]
    return here[nearest(search_tree(body.z[here]), seeds, k=size)[1]]


def registered(frames: Frames, canonical: int, body: Body, regions: IntArray) -> list[Proposal]:
    """Every region (R, n) with the motion that registers it to the body's points of every frame."""
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
        y = transform(D[owner, f], x)
        gain += (fit_cost(tree, normals, x, nx) - fit_cost(tree, normals, y, nx)).reshape(R, -1).mean(axis=1)
    return [Proposal(regions[r], body.T @ D[r], gain[r] / (F - 1)) for r in range(R)]


def directions(canonical: int, body: Body, other: Body | None) -> list[tuple[Array, float]]:
    """Twists (6,) that move the body by about one spacing, and how far to try: as it moves against the other, and those
    of which its own points say least."""
    out, centre = [], body.z.mean(axis=0)
    if other is not None:
        against = inverse(other.T) @ body.T
        way = np.linalg.norm(transform(against, centre) - centre, axis=1)
        far = int(way.argmax())
        if way[far] > 1.0:
            out.append((log_se3(against)[far] / way[far], BEYOND * float(way[far])))
    H = np.delete(pair_equations(body, SIGMA)[0], canonical, axis=0).sum(axis=0)
    weak = weak_directions(H, body.z)[:DIRECTIONS]
    return out + [(twist, STEP * MOST) for twist in weak]


def swept(
    canonical: int, body: Body, regions: IntArray, noise: float, twist: Array, far: float, count: int
) -> list[Proposal]:
    """The `count` regions of (R, n) that gain most from a motion along a twist, with the best of these in every frame.
    Which ones is told by a few frames."""
    shown = [f for f in range(len(body.T)) if f != canonical and np.count_nonzero(body.frame == f) >= SEEN]
    if len(regions) == 0 or not shown:
        return []
    steps = int(np.clip(far / STEP, 1, MOST))
    shifts = exp_se3(STEP * np.arange(-steps, steps + 1)[:, None] * twist)
    few = [shown[k] for k in evidence_frames(len(shown), FEW)]
    gain = np.zeros(len(regions))
    for f in few:
        misfit = _along(canonical, body, regions, noise, shifts, f)
        gain += (misfit[steps] - misfit.min(axis=0)) / len(few)
    out = []
    best = [r for r in np.argsort(-gain, kind="stable")[:count] if gain[r] > PROMISE]
    for r in best:
        T = body.T.copy()
        for f in shown:
            T[f] = body.T[f] @ shifts[_along(canonical, body, regions[[r]], noise, shifts, f)[:, 0].argmin()]
        out.append(Proposal(regions[r], T, float(gain[r])))
    return out


def _along(canonical: int, body: Body, regions: IntArray, noise: float, shifts: Array, f: int) -> Array:
    """(S, R) mean misfit of every region to the body's points of frame f, after each of the shifts (S, 4, 4)."""
    sample = regions[:, :: max(1, regions.shape[1] // ASKED)]
    moved = transform(shifts[:, None], body.z[sample.ravel()])
    own = np.full(moved.shape[0] * moved.shape[1], canonical)
    return partners(moved.reshape(-1, 3), own, body, noise, [f])[0].reshape(len(shifts), *sample.shape).mean(axis=2)
