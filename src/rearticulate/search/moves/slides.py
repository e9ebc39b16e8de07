"""Slides: a second motion of a body's points that differs from the body's own by shifts along one screw.

A wall that slides in itself fits both motions nearly everywhere; what tells is where it ends. So only places that a
frame denies altogether count, and all points of the body are asked at once: each goes with the one of the two motions
that denies it less. The shift that is best so, along each of a few screws, is a second motion.
"""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float
from rearticulate.geometry.se3 import exp_se3, inverse, log_se3, transform
from rearticulate.observe.body import Body, denied, partners
from rearticulate.observe.misfit import evidence_frames

FEW = 3  # frames that tell which screws are worth a try
ASKED = 300  # points of a frame of a body
SEEN = 8  # points of a frame of a body, at least
STEP, MOST = 0.7, 40  # spacings; steps to each side, at most


def screws(body: Body, other: Body | None) -> Float[Array, "k 6"]:
    """Twists that move the body by about one spacing: along the principal directions of its normals, and as it moves
    against another body."""
    out = [np.r_[np.zeros(3), axis] for axis in np.linalg.eigh(body.normals.T @ body.normals)[1].T]
    if other is not None:
        against, centre = inverse(other.T) @ body.T, body.z.mean(axis=0)
        way = np.linalg.norm(transform(against, centre) - centre, axis=1)
        far = int(way.argmax())
        if way[far] > 1.0:
            out.append(log_se3(against)[far] / way[far])
    return np.stack(out)


def slides(
    canonical: int, body: Body, noise: float, twists: Float[Array, "k 6"], count: int, least: float
) -> list[Float[Array, "F 4 4"]]:
    """Second motions along the `count` twists that promise most, at least `least` in misfit a frame."""
    shown = [f for f in range(len(body.T)) if np.count_nonzero(body.frame == f) >= SEEN]
    if canonical not in shown or len(shown) < 2:
        return []
    shown.remove(canonical)
    most = min(MOST, int(np.linalg.norm(np.ptp(body.z, axis=0)) / STEP))  # farther nothing of it meets
    sizes = STEP * np.arange(-most, most + 1)
    few = [shown[k] for k in evidence_frames(len(shown), FEW)]
    curves = [{f: _curve(canonical, body, noise, sizes, twist, f) for f in few} for twist in twists]
    promise = np.array([np.mean([np.median(c) - c.min() for c in found.values()]) for found in curves])
    out = []
    for k in np.argsort(-promise, kind="stable")[:count]:
        if promise[k] < least:
            break
        T = body.T.copy()
        for f in shown:
            curve = curves[k][f] if f in few else _curve(canonical, body, noise, sizes, twists[k], f)
            T[f] = T[f] @ exp_se3(sizes[curve.argmin()] * twists[k])
        out.append(T)
    return out


def _curve(
    canonical: int, body: Body, noise: float, sizes: Float[Array, " S"], twist: Float[Array, " 6"], f: int
) -> Float[Array, " S"]:
    """What remains denied of the points of frame f and of the canonical one, each asked in the other, if each takes the
    better of no shift and one of these, the middle one of which is none."""
    D = exp_se3(sizes[:, None] * twist)
    out = np.zeros(len(sizes))
    for here, there, shifts in ((canonical, f, D), (f, canonical, inverse(D))):
        rows = np.flatnonzero(body.frame == here)
        stride = max(1, len(rows) // ASKED)
        moved = transform(shifts[:, None], body.z[rows[::stride]]).reshape(-1, 3)
        misfit = partners(moved, np.full(len(moved), here), body, noise, [there])[0].reshape(len(sizes), -1)
        value = denied(misfit)
        out += stride * np.minimum(value[len(sizes) // 2], value).sum(axis=1)
    return out
