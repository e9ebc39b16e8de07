"""Labels by own-part evidence: which body's surface a point belongs to.

`relabel` lets points and coherent regions change sides; `exchange` gives whole flat layers to one body. Both lower
the score under given motions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.se3 import rotate_by
from rearticulate.observe.body import REACH, Body, carried, misfits, own_misfits
from rearticulate.observe.frames import Frames
from rearticulate.observe.planes import plane_layers
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, all_misfits, fresh, group, labels_of, make_bodies, own_normals, poses
from rearticulate.parts.cuts import Borders, expand, sheet_borders
from rearticulate.parts.sheets import doubtful, part_distances
from rearticulate.progress import Told, steps, untold

NEAR, FAR = 3.7, 40.0  # spacings; bodies that are candidates for single points, and for layers
ROUNDS, INNER = 3, 2
SETTLED = 3e-3  # share of points that change in the last round
FITS = 6.0  # misfit of a point to any points around it, beyond which it is in no layer of a body
LEAST_LAYER, LEAST_TAKEN = 12, 3  # points of a layer, and of those that it takes
GAIN = 0.05  # what a layer must bring for each point that changes sides, in units of misfit


def candidates_near(frames: Frames, labels: Int[Array, " M"], P: int, radius: float) -> Bool[Array, "M P"]:
    """Bodies with a point that near in the same frame, the point's own among them."""
    out = np.isfinite(part_distances(frames, labels, P, radius))
    out[np.arange(len(labels)), labels] = True
    return out


def relabel(frames: Frames, bodies: Bodies, rounds: int = ROUNDS, told: Told = untold) -> Bodies:
    """The bodies with labels of least cost under their motions: expansions, in turn with the evidence they change."""
    P, M, T = len(bodies), len(frames.points), poses(bodies)
    labels = labels_of(bodies, M)
    for each_round in steps(told, rounds):
        before, borders = labels, sheet_borders(frames, own_normals(bodies, M))
        candidates = candidates_near(frames, labels, P, NEAR)
        each_round(0.5)
        for _ in range(INNER):
            last, cost = labels, costs(frames, bodies, candidates)
            for p in range(P):
                labels = expand(cost, labels, borders, p)
            bodies = make_bodies(frames, T, labels, bodies)
            if np.mean(labels != last) < SETTLED:
                break
        if np.mean(labels != before) < SETTLED:
            break
    return bodies


def costs(frames: Frames, bodies: Bodies, candidates: Bool[Array, "M P"]) -> Float[Array, "M P"]:
    """Misfit of every point if it were each of its candidates', inf elsewhere; 0 where it has but one."""
    out = np.where(candidates, 0.0, np.inf)
    asked = candidates & doubtful(candidates)[:, None]

    def ask(p: int) -> None:
        rows = np.flatnonzero(asked[:, p])
        out[rows, p] = misfits(*bodies[p].carry(frames, rows), bodies[p], frames.noise)

    each(ask, range(len(bodies)))
    return out


@dataclass
class Ownership:
    """Labels, normals in the points' frames and misfits now, while layers change sides. z: of `carried`, so far."""

    frames: Frames
    bodies: Bodies
    labels: Int[Array, " M"]
    normals: Float[Array, "M 3"]
    now: Float[Array, " M"]
    borders: Borders
    z: dict[int, Float[Array, "M 3"]]

    def carried(self, p: int | np.integer) -> Float[Array, "M 3"]:
        """All points, at canonical, if they were of body p."""
        if p not in self.z:
            self.z[int(p)] = self.bodies[p].carry(self.frames, np.arange(len(self.labels)))[0]
        return self.z[int(p)]

    def as_if(self, p: int | np.integer, rows: Int[Array, " n"]) -> Body:
        """These points as body p."""
        return carried(self.frames, rows, self.bodies[p].T, self.normals)

    def give(self, p: int, members: Int[Array, " n"], normals: Float[Array, "n 3"], least: float) -> bool:
        """Give these points, with new normals, to body p if that lowers the cost by `least` at least."""
        labels, old = self.labels.copy(), self.normals[members]
        labels[members], self.normals[members] = p, normals
        change = self.borders.grown(self.labels, members, p)
        affected = []
        losers = np.setdiff1d(self.labels[members], p)
        for q in [p, *losers]:  # first the one that gains: it pays for what others lose
            z, now = self.carried(q), np.flatnonzero(labels == q)
            spot = z[members if q == p else members[self.labels[members] == q]]
            cloud = self.as_if(q, now[_in_box(z[now], spot, 2 * REACH)])
            if len(cloud):
                asked = _in_box(cloud.z, spot, REACH)
                value = own_misfits(cloud, self.frames.noise, asked)
                affected.append((cloud.rows[asked], value))
                change += float((value - self.now[cloud.rows[asked]]).sum())
            if change > -least:
                self.normals[members] = old
                return False
        self.labels = labels
        for rows, value in affected:
            self.now[rows] = value
        return True


def _in_box(z: Float[Array, "n 3"], spot: Float[Array, "m 3"], reach: float) -> Int[Array, " k"]:
    """Points of z in the box around those of spot."""
    return np.flatnonzero(((z > spot.min(axis=0) - reach) & (z < spot.max(axis=0) + reach)).all(axis=1))


def exchange(frames: Frames, bodies: Bodies, tried: Bodies = (), told: Told = untold) -> Bodies:
    """The bodies after flat layers have gone to one of them where that lowers the cost.

    The layers of a body are those of the cloud that all points make which its motion explains, whatever their labels:
    a wall that slides in itself is one layer under both motions, and goes as one.
    """
    M, P = len(frames.points), len(bodies)
    labels, normals = labels_of(bodies, M), own_normals(bodies, M)
    borders = sheet_borders(frames, normals)
    state = Ownership(frames, bodies, labels, normals, all_misfits(bodies, M, frames.noise), borders, {})
    edge = np.bincount(borders.i, borders.cost, minlength=M) + np.bincount(borders.j, borders.cost, minlength=M)
    near = candidates_near(frames, labels, P, FAR)
    chosen = [p for p, new in enumerate(fresh(bodies, tried)) if new]
    for p, told_one in zip(chosen, steps(told, len(chosen)), strict=True):
        told_one(0.0)
        for layer in _layers(frames, state, p, near[:, p]):
            taken = state.labels[layer.rows] != p
            least = GAIN * np.count_nonzero(taken)
            most = np.maximum(state.now[layer.rows] - layer.fits, 0.0).sum() + edge[layer.rows[taken]].sum()
            if np.count_nonzero(taken) >= LEAST_TAKEN and most > least:
                state.give(p, layer.rows, layer.normals, least)
    after = group(frames, poses(bodies), state.labels, state.normals)
    return tuple(old if np.array_equal(old.rows, new.rows) else new for old, new in zip(bodies, after, strict=True))


@dataclass(frozen=True)
class Layer:
    """Points (n,) of one flat layer under a body's motion: their misfits, and their normals in their frames."""

    rows: Int[Array, " n"]
    fits: Float[Array, " n"]
    normals: Float[Array, "n 3"]


def _layers(frames: Frames, state: Ownership, p: int, near: Bool[Array, " M"]) -> list[Layer]:
    """Of the points near body p that its motion explains, the largest first."""
    rows = np.flatnonzero(near | (state.labels == p))
    anyone = state.as_if(p, rows)
    fits = own_misfits(anyone, frames.noise)
    kept = np.flatnonzero((fits < FITS) | (state.labels[rows] == p))
    layer, planes = plane_layers(anyone.z[kept])
    normals = rotate_by(anyone.T, anyone.frame[kept], planes)
    members = np.split(np.argsort(layer, kind="stable"), np.cumsum(np.bincount(layer + 1)))[1:]
    members = sorted((m for m in members if len(m) >= LEAST_LAYER), key=len, reverse=True)
    return [Layer(rows[kept[m]], fits[kept[m]], normals[m]) for m in members]
