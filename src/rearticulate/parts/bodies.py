"""All bodies of an object: every point of every frame belongs to one of them.

The score says, in squared units of deviation, how well the bodies explain the clouds: the misfit of all points, the
length of the borders within sheets, and what a body costs to describe, a joint and its values (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.se3 import adjoint, inverse, rotate_by
from rearticulate.observe.body import (
    EVIDENCE_FRAMES,
    Body,
    Pairs,
    alike,
    carried,
    grown_with,
    growth,
    make_body,
    own_misfits,
    pair_equations,
    register,
    shares,
    total,
)
from rearticulate.observe.frames import Frames
from rearticulate.observe.misfit import evidence_frames
from rearticulate.parallel import each
from rearticulate.parts.cuts import Borders, sheet_borders
from rearticulate.parts.relaxed import Relaxed, keep_parts

Bodies = tuple[Body, ...]

LEAST = 3  # points a frame of a body


def make_bodies(frames: Frames, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"], before: Bodies = ()) -> Bodies:
    """One for each part of T and labels. before: bodies that may have mostly the same points and about the same
    motion."""

    def make(p: int) -> Body:
        return make_body(frames, np.flatnonzero(labels == p), T[:, p], before[p] if p < len(before) else None)

    return tuple(each(make, range(T.shape[1])))


def group(frames: Frames, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"], normals: Float[Array, "M 3"]) -> Bodies:
    """As `make_bodies`, with known normals of all points in their frames."""
    return tuple(carried(frames, np.flatnonzero(labels == p), T[:, p], normals) for p in range(T.shape[1]))


def poses(bodies: Bodies) -> Float[Array, "F P 4 4"]:
    return np.stack([body.T for body in bodies], axis=1)


def labels_of(bodies: Sequence[Body], M: int) -> Int[Array, " M"]:
    """-1 where a point is no body's."""
    labels = np.full(M, -1)
    for p, body in enumerate(bodies):
        labels[body.rows] = p
    return labels


def to_relaxed(bodies: Bodies, M: int) -> Relaxed:
    """As poses and the labels of all M points."""
    return Relaxed(poses(bodies), labels_of(bodies, M))


def own_normals(bodies: Bodies, M: int) -> Float[Array, "M 3"]:
    """Normals of all points, in their frames."""
    out = np.empty((M, 3))
    for body in bodies:
        out[body.rows] = rotate_by(body.T, body.frame, body.normals)
    return out


def all_misfits(bodies: Bodies, M: int, noise: float) -> Float[Array, " M"]:
    """Misfit of every point to its own body."""
    out = np.empty(M)
    for body, found in zip(bodies, each(lambda body: own_misfits(body, noise), bodies), strict=True):
        out[body.rows] = found
    return out


def price(frames: Frames) -> float:
    """What a body must earn: an axis, and a joint value a frame."""
    return (3 + frames.n_frames) * float(np.log(len(frames.points)))


@dataclass(frozen=True)
class Explanation:
    """How well so many bodies explain the clouds. shares: of all points (`observe.body`); rest: cost of borders and of
    the description of the bodies; score: twice minus the log-likelihood, with what frames cannot tell of as denied, and
    the rest. Lower is better."""

    shares: Float[Array, "M G"]
    rest: float
    score: float
    bodies: int

    def over(self, other: Explanation | None) -> float:
        """By how much this score is the higher one, as far as the frames tell of both, at most where it has more
        bodies, and at least where fewer; minus infinity where there is no other."""
        if other is None:
            return -np.inf
        grown = grown_with(growth(other.shares, self.shares), self.bodies - other.bodies)
        return grown + self.rest - other.rest


def explanation(frames: Frames, bodies: Bodies) -> Explanation:
    M, found = len(frames.points), all_shares(frames, bodies)
    rest = sheet_borders(frames, own_normals(bodies, M)).between(labels_of(bodies, M))
    rest += price(frames) * (len(bodies) - 1)
    return Explanation(found, rest, total(found, frames.frame, frames.n_frames) + rest, len(bodies))


def score(frames: Frames, bodies: Bodies) -> float:
    """See `Explanation`."""
    return explanation(frames, bodies).score


def all_shares(frames: Frames, bodies: Sequence[Body]) -> Float[Array, "M G"]:
    """Shares of all points, nan of those that are no body's."""
    out = np.full((len(frames.points), len(evidence_frames(frames.n_frames, EVIDENCE_FRAMES))), np.nan)
    for body, found in zip(bodies, each(lambda body: shares(frames, body), bodies), strict=True):
        out[body.rows] = found
    return out


def score_of(frames: Frames, T: Float[Array, "F P 4 4"], labels: Int[Array, " M"]) -> float:
    """Score of the parts of poses T and labels, those without points among them."""
    return score(frames, make_bodies(frames, T, labels))


def border_between(borders: Borders, a: Int[Array, " A"], b: Int[Array, " B"], M: int) -> float:
    """Cost of the borders between two sets of points."""
    side = np.zeros(M, dtype=np.int8)
    side[a], side[b] = 1, 2
    return float(borders.cost[side[borders.i] * side[borders.j] == 2].sum())


def bodies_equations(
    bodies: Bodies, sigma: float, pairs: Sequence[Pairs] = ()
) -> tuple[Float[Array, "F P 6 6"], Float[Array, "F P 6"]]:
    """Normal equations H, g of left twists of the poses T. A left twist of a frame's points at canonical is -inv(T)
    (twist) T of its pose. pairs: of each body, where they are known."""
    found = each(lambda p: pair_equations(bodies[p], sigma, pairs[p] if pairs else None), range(len(bodies)))
    H, g = (np.stack(each, axis=1) for each in zip(*found, strict=True))
    A = adjoint(inverse(poses(bodies)))
    A_t = np.swapaxes(A, -1, -2)
    return A_t @ H @ A, -(A_t @ g[..., None])[..., 0]


def fresh(bodies: Bodies, tried: Bodies) -> list[bool]:
    """Which bodies are others than those that were tried."""
    return [not any(alike(body, old) for old in tried) for body in bodies]


def settled(frames: Frames, canonical: int, bodies: Bodies, sigmas: Sequence[float]) -> Bodies:
    """Every body registered anew."""
    return tuple(each(lambda body: register(frames, canonical, body, sigmas) if len(body) else body, bodies))


def without_crumbs(frames: Frames, bodies: Bodies) -> Bodies:
    """Bodies with hardly any points go; their points go to the body of the nearest other point of their frame."""
    sizes = np.array([len(body) for body in bodies])
    keep = np.flatnonzero((sizes >= LEAST * frames.n_frames) | (np.arange(len(bodies)) == sizes.argmax()))
    if len(keep) == len(bodies):
        return bodies
    model = keep_parts(frames, to_relaxed(bodies, len(frames.points)), keep)
    return make_bodies(frames, model.T, model.labels, tuple(bodies[p] for p in keep))
