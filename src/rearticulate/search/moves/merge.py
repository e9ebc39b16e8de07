"""Merge: two bodies that touch, or move alike, become one where one motion explains the points of both as well."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.observe.body import Body, grown_with, growth, join, make_body, register, shares
from rearticulate.observe.frames import Frames
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, border_between, fresh, labels_of, own_normals, price
from rearticulate.parts.cuts import Borders, sheet_borders
from rearticulate.parts.ownership import candidates_near
from rearticulate.progress import Told, rounds, untold

TOUCH = 4.0  # spacings; bodies that come this near, in any frame
ALIKE = 2.0  # spacings; ... or whose points would be no farther away, on average, if they moved as the other does
ASKED = 500  # points of each body that a first look asks
ROUGH, FINE = (0.8, 0.3), (0.4, 0.3)  # robust scales of the registration of both as one
HOPELESS = 4.0  # prices; growth of the score at a first look beyond which the pair is not looked at again


@dataclass(frozen=True)
class Union:
    """Two bodies as one, by how much that raises misfit and borders, and its shares; those of some points alone where
    that was enough to see that it is hopeless."""

    cost: float
    body: Body
    shares: Float[Array, "_ G"]


@dataclass
class _Merging:
    """Bodies by number while they are merged; their shares; the unions of pairs."""

    frames: Frames
    canonical: int
    borders: Borders
    body: dict[int, Body]
    shares: dict[int, Float[Array, "_ G"]]
    pair: dict[tuple[int, int], Union]
    possible: Bool[Array, "P P"]

    def untested(self) -> Iterator[tuple[int, int]]:
        for a in self.body:
            for b in self.body:
                if a < b and self.possible[a, b] and (a, b) not in self.pair:
                    yield a, b

    def test(self, a: int, b: int) -> Union:
        A, B = self.body[a], self.body[b]
        border = border_between(self.borders, A.rows, B.rows, len(self.frames.points))
        i, j = _sample(0, len(A)), _sample(len(A), len(B))
        tries = []
        for T in (A.T, B.T):
            both = join(A.moved(T), B.moved(T))
            both = register(self.frames, self.canonical, both, ROUGH, asked=2 * ASKED, renew=False)
            found = shares(self.frames, both, np.concatenate([i, j]))
            more_a = growth(self.shares[a][i], found[: len(i)]) * (len(A) / len(i))
            more_b = growth(self.shares[b][j - len(A)], found[len(i) :]) * (len(B) / len(j))
            tries.append(Union(grown_with(np.concatenate([more_a, more_b]), -1) - border, both, found))
        best = min(tries, key=lambda union: union.cost)
        if best.cost > HOPELESS * price(self.frames):
            return best
        union = make_body(self.frames, np.sort(best.body.rows), best.body.T)
        union = register(self.frames, self.canonical, union, FINE)
        before = np.concatenate([self.shares[a], self.shares[b]])[np.argsort(np.concatenate([A.rows, B.rows]))]
        found = shares(self.frames, union)
        return Union(grown_with(growth(before, found), -1) - border, union, found)

    def merge(self, a: int, b: int) -> None:
        """The second becomes part of the first."""
        self.body[a], self.shares[a] = self.pair[a, b].body, self.pair[a, b].shares
        del self.body[b], self.shares[b]
        self.possible[a] |= self.possible[b]
        self.possible[:, a] |= self.possible[:, b]
        self.pair = {e: found for e, found in self.pair.items() if not {a, b} & set(e)}


def _sample(first: int, n: int) -> Int[Array, " m"]:
    return np.arange(first, first + n, max(1, n // ASKED))


def possible(frames: Frames, bodies: Bodies) -> Bool[Array, "P P"]:
    """Which bodies come near each other in any frame, or move nearly alike; a body that comes near none, and its
    nearest."""
    P, labels = len(bodies), labels_of(bodies, len(frames.points))
    near = candidates_near(frames, labels, P, TOUCH)
    out = np.stack([near[body.rows].any(axis=0) for body in bodies])
    for a, b in np.argwhere(~out):
        here, there = (
            transform(body.T[:, None], bodies[a].z[_sample(0, len(bodies[a]))]) for body in (bodies[a], bodies[b])
        )
        out[a, b] = np.linalg.norm(here - there, axis=-1).mean() < ALIKE
    out = (out | out.T) & ~np.eye(P, dtype=bool)
    for a in np.flatnonzero(~out.any(axis=1)) if P > 1 else ():
        far = [np.inf if body is bodies[a] else nearest(search_tree(body.z), bodies[a].z)[0].min() for body in bodies]
        b = int(np.argmin(far))
        out[a, b] = out[b, a] = True
    return out


def merge_bodies(frames: Frames, canonical: int, bodies: Bodies, tried: Bodies = (), told: Told = untold) -> Bodies:
    """Merge while the score falls, the pair that lowers it most first; one of the two was not tried."""
    new = fresh(bodies, tried)
    borders = sheet_borders(frames, own_normals(bodies, len(frames.points)))
    numbered = dict(enumerate(bodies))
    now = dict(enumerate(each(lambda body: shares(frames, body), bodies)))
    pairs = possible(frames, bodies) & np.logical_or.outer(new, new)
    state = _Merging(frames, canonical, borders, numbered, now, {}, pairs)
    for _ in rounds(told):
        pairs = list(state.untested())
        state.pair.update(zip(pairs, each(lambda pair: state.test(*pair), pairs), strict=True))
        best = min(state.pair, key=lambda pair: state.pair[pair].cost, default=None)
        if best is None or state.pair[best].cost >= price(frames):
            break
        state.merge(*best)
    return tuple(state.body.values())
