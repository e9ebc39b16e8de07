"""Sweep: where the points say little about how a body moved, along a bar, within a plate, about a near-axis, its poses
are tried over the whole range, one weak direction at a time, against the canonical frame."""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float
from rearticulate.geometry.nearest import rms_radius
from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, rotate, transform
from rearticulate.observe.body import Body, pair_equations, partners, register
from rearticulate.observe.frames import Frames
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, fresh

WEAK = 0.04  # of the information of a pair; what is stronger is found by registration
REACH = 0.5  # of the body's rms radius, to both sides
STEP, MOST = 0.7, 40  # spacings; steps to each side
WORTH = 4.0  # misfit by which a sweep must lower that of both frames
SCALES = (0.4, 0.3)
SIGMA = 0.5
LEAST = 8


def sweep_bodies(frames: Frames, canonical: int, bodies: Bodies, tried: Bodies = ()) -> Bodies:
    """All bodies, those that were not tried swept where they may be."""
    new = fresh(bodies, tried)
    return tuple(each(lambda p: sweep(frames, canonical, bodies[p]) if new[p] else bodies[p], range(len(bodies))))


def weak_directions(H: Float[Array, "6 6"], z: Float[Array, "n 3"]) -> Float[Array, "k 6"]:
    """Twists that move the points z by about one spacing and of which the information H says little."""
    centre, radius = z.mean(axis=0), max(rms_radius(z), 1.0)
    shift = np.eye(4)
    shift[:3, 3] = centre
    basis = adjoint(shift) @ np.diag([1 / radius] * 3 + [1.0] * 3)
    local = basis.T @ H @ basis
    values, vectors = np.linalg.eigh(local)
    share = values / max(np.trace(local[3:, 3:]), 1e-9)
    return (basis @ vectors[:, share < WEAK]).T


def sweep(frames: Frames, canonical: int, body: Body) -> Body:
    """The body with the poses of single frames shifted along weak directions where that explains the points better."""
    here = body.take(body.frame == canonical)
    if len(here) < LEAST:
        return body
    H, moved = pair_equations(body, SIGMA)[0], False
    T, z, normals = body.T.copy(), body.z.copy(), body.normals.copy()
    for f in range(frames.n_frames):
        there = body.take(body.frame == f)
        if f == canonical or len(there) < LEAST:
            continue
        D = np.eye(4)
        for twist in weak_directions(H[f], there.z):
            count = int(min(REACH * rms_radius(there.z) / STEP, MOST))
            sizes = STEP * np.arange(-count, count + 1)
            shifts = exp_se3(sizes[:, None] * twist) @ D
            cost = _misfits(here, there, shifts, frames.noise)
            if cost.min() < cost[count] - WORTH:
                D, moved = shifts[int(cost.argmin())], True
        rows = body.frame == f
        T[f] = T[f] @ inverse(D)
        z[rows], normals[rows] = transform(D, there.z), rotate(D, there.normals)
    return register(frames, canonical, Body(body.rows, body.frame, T, z, normals), SCALES) if moved else body


def _misfits(here: Body, there: Body, D: Float[Array, "S 4 4"], noise: float) -> Float[Array, " S"]:
    """Of the points of two frames to each other, those of the second moved by each D."""
    out = np.zeros(len(D))
    for body, other, moves in ((there, here, D), (here, there, inverse(D))):
        moved = transform(moves[:, None], body.z).reshape(-1, 3)
        frame = np.full(len(moved), body.frame[0])
        out += partners(moved, frame, other, noise, [int(other.frame[0])])[0].reshape(len(D), -1).sum(axis=1)
    return out
