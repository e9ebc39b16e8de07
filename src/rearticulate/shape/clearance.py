"""Convex bodies that move against each other, cut back until there is a gap between them wherever they go.

Surfaces of neighbours interlock: a pin sits in its bore, a drawer in a cabinet that a scan shows as solid. Their convex
pieces then overlap, and a simulator pushes them apart although nothing moves. Of two pieces that meet, one is cut by
planes that the other never crosses: what remains is convex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.se3 import inverse
from rearticulate.shape.convex import Convex

Array = NDArray[np.floating]

ENOUGH = 0.9  # share of a body that one cut must leave: else the way is taken in halves, the body in two
FEW = 4  # poses that are not taken in halves
CRUMB = 0.1  # share of a body that is worth a piece of its own
THIN = 2.0  # a remainder thinner than this many gaps is left out
_SIDES = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], dtype=float)
_SIDES /= np.linalg.norm(_SIDES, axis=1, keepdims=True)


@dataclass(frozen=True)
class Obstacle:
    """A convex body and its way: poses (m, 4, 4), each close to the next."""

    body: Convex
    way: Array

    def normals(self) -> Array:
        """(k, 3) of planes that may hold it back."""
        return np.concatenate([_SIDES, self.body.normals @ self.way[len(self.way) // 2, :3, :3].T])

    def reach(self, normals: Array) -> Array:
        """(k,) how far it comes along directions (k, 3), wherever it is."""
        turned = np.einsum("mji,kj->mki", self.way[:, :3, :3], normals)
        far = (turned @ self.body.corners.T).max(axis=-1) + self.way[:, :3, 3] @ normals.T
        return far.max(axis=0)

    def halves(self) -> tuple[Obstacle, Obstacle]:
        """On the first and on the second half of the way, with the pose in the middle in both."""
        k = len(self.way) // 2
        return Obstacle(self.body, self.way[: k + 1]), Obstacle(self.body, self.way[k:])


def volume(bodies: Sequence[Convex]) -> float:
    """Sum, m^3."""
    return sum(body.volume for body in bodies)


def spared(body: Convex, obstacle: Obstacle, gap: float) -> list[Convex]:
    """What of a body is a gap away from an obstacle all along its way: the very body where all of it is, else parts."""
    normals = np.concatenate([obstacle.normals(), -body.normals])
    reach = obstacle.reach(normals) + gap
    if ((body.corners @ normals.T).min(axis=0) >= reach).any():
        return [body]
    best, kept = _best(body, normals, reach)
    if kept < ENOUGH and len(obstacle.way) > FEW:
        first, second = obstacle.halves()
        return [part for half in spared(body, first, gap) for part in spared(half, second, gap)]
    parts = [body.beyond(normals[best], reach[best])]
    other = body.beyond(-normals[best], -reach[best]) if kept < ENOUGH else None
    if other is not None:
        best, _ = _best(other, normals, reach)
        second = other.beyond(normals[best], reach[best])
        parts += [second] if second is not None and second.volume > CRUMB * body.volume else []
    return [part for part in parts if part is not None and part.thickness > THIN * gap]


def _best(body: Convex, normals: Array, reach: Array) -> tuple[int, float]:
    """The plane beyond which most of a body lies, and the share that does."""
    share = (body.probes @ normals.T >= reach).mean(axis=0)
    return int(np.argmax(share)), float(share.max())


class Pieces:
    """The pieces of all bodies, each as the parts that are left of it. bodies: by their numbers. gap: between any two,
    m."""

    def __init__(self, bodies: dict[int, list[Convex]], gap: float) -> None:
        self.gap = gap
        self.left = {j: [[piece] for piece in own] for j, own in bodies.items()}
        self.whole = {j: volume(own) for j, own in bodies.items()}
        self.centres = {j: np.array([piece.centre for piece in own]) for j, own in bodies.items()}
        self.radii = {j: np.array([piece.radius for piece in own]) for j, own in bodies.items()}

    def near(self, a: int, b: int, T_a_b: Array) -> NDArray[np.bool_]:
        """(m, pieces of a, pieces of b) whether the balls around them meet at poses (m, 4, 4)."""
        centres = np.einsum("mij,bj->mbi", T_a_b[:, :3, :3], self.centres[b]) + T_a_b[:, None, :3, 3]
        apart = np.linalg.norm(centres[:, None] - self.centres[a][None, :, None], axis=-1)
        return apart < self.radii[a][:, None] + self.radii[b] + self.gap

    def clear(self, a: int, b: int, T_a_b: Array) -> None:
        """Cut the pieces of a or of b that meet on a way of b (m, 4, 4) in the frame of a. Of two that meet, the one
        gives way whose body loses the smaller share of its volume."""
        near = self.near(a, b, T_a_b)
        for i, k in np.argwhere(near.any(axis=0)):
            when = np.flatnonzero(near[:, i, k])
            way = T_a_b[when[0] : when[-1] + 1]
            one, two = self.left[a][i], self.left[b][k]
            rest = _all_spared(one, two, way, self.gap)
            if rest == one:
                continue
            other = _all_spared(two, one, inverse(way), self.gap)
            if (volume(one) - volume(rest)) / self.whole[a] <= (volume(two) - volume(other)) / self.whole[b]:
                self.left[a][i] = rest
            else:
                self.left[b][k] = other

    def parts(self, j: int) -> list[Convex]:
        """What is left of a body."""
        return [part for piece in self.left[j] for part in piece]

    def lost(self, j: int) -> float:
        """Share of the volume of a body's pieces that is cut away."""
        return 1 - volume(self.parts(j)) / self.whole[j]


def _all_spared(bodies: list[Convex], others: list[Convex], way: Array, gap: float) -> list[Convex]:
    """What of bodies no other one touches."""
    for other in others:
        bodies = [part for body in bodies for part in spared(body, Obstacle(other, way), gap)]
    return bodies
