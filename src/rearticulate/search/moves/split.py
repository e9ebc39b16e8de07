"""Split: a body becomes two where a second motion explains some of its points so much better that it pays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.observe.body import Body, make_body, misfits, own_misfits, register
from rearticulate.observe.frames import Frames
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, fresh, own_normals, price
from rearticulate.parts.cuts import Borders, expand, sheet_borders
from rearticulate.search.moves.regions import directions, regions_of, registered, swept

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
Two = tuple[float, Body, Body]  # misfit and border of two bodies in place of one, and the two

LEAST = 6  # points a frame of each of two bodies
LOOSE = 3.0  # spacings; components are farther apart
NEIGHBOURS = 8
COMPONENTS = 6  # tried, at most
AROUND = 3.0  # spacings; a second body begins with the points that near a region
PROMISE = 0.1  # fall of a point's misfit in a region under a motion of its own that is worth a try
TRIES, ROUNDS, INNER = 2, 4, 2
HOPELESS = 4.0  # prices; growth of the score after a round beyond which there are no more
APART, SCALES = (0.8, 0.3), (0.4,)  # robust scales of registrations of components, and of two that were one
SETTLED = 5e-3


def split_bodies(frames: Frames, canonical: int, bodies: Bodies, tried: Bodies = ()) -> Bodies:
    """Every body that was not tried and pays as two is two."""
    new = fresh(bodies, tried)
    borders = sheet_borders(frames, own_normals(bodies, len(frames.points)))

    def parts(body: Body, other: Body | None) -> Bodies:
        """What becomes of one body; what was split may be split again."""
        now = float(own_misfits(body, frames.noise).sum())
        options = [by_components(frames, canonical, body), *by_regions(frames, canonical, body, other, borders, now)]
        cost, first, second = min(options, key=lambda two: two[0])
        if now - cost < price(frames):
            return (body,)
        return (*parts(first, second), *parts(second, first))

    def work(p: int) -> Bodies:
        others = [other for q, other in enumerate(bodies) if q != p]
        return parts(bodies[p], max(others, key=len, default=None)) if new[p] else (bodies[p],)

    return tuple(part for found in each(work, range(len(bodies))) for part in found)


def nothing(body: Body) -> Two:
    return np.inf, body, body


def components(body: Body) -> IntArray:
    """(n,) of the points, connected by short steps."""
    n = len(body)
    near = nearest(search_tree(body.z), body.z, k=min(NEIGHBOURS, n), within=LOOSE)[1].reshape(n, -1)
    i, k = np.nonzero(near < n)
    return connected_components(coo_matrix((np.ones(len(i)), (i, near[i, k])), shape=(n, n)), directed=False)[1]


def by_components(frames: Frames, canonical: int, body: Body) -> Two:
    """The best split of what does not touch the rest of the body."""
    component = components(body)
    size, least = np.bincount(component), LEAST * frames.n_frames
    best = nothing(body)
    for q in np.argsort(-size, kind="stable")[:COMPONENTS]:
        second = component == q
        if min(size[q], len(body) - size[q]) >= least:
            halves = [make_body(frames, body.rows[side], body.T) for side in (~second, second)]
            two = [register(frames, canonical, half, APART) for half in halves]
            cost = sum(float(own_misfits(each, frames.noise).sum()) for each in two)
            best = min(best, (cost, two[0], two[1]), key=lambda found: found[0])
    return best


def by_regions(
    frames: Frames, canonical: int, body: Body, other: Body | None, borders: Borders, now: float
) -> list[Two]:
    """Splits that begin with a region that a motion of its own explains better. other: a body that it may move
    against. now: misfit of the body."""
    regions = regions_of(body, canonical)
    tries = registered(frames, canonical, body, regions)
    tries = sorted((found for found in tries if found.gain > PROMISE), key=lambda found: -found.gain)[:TRIES]
    if len(regions):
        for twist, far in directions(canonical, body, other):
            tries += swept(canonical, body, regions, frames.noise, twist, far, TRIES)
    out = []
    for found in tries:
        second = nearest(search_tree(body.z[found.rows]), body.z, within=AROUND)[0] < AROUND
        out.append(separate(frames, canonical, body, second, found.T, borders, now))
    return out


def separate(
    frames: Frames, canonical: int, body: Body, second: NDArray[np.bool_], T: Array, borders: Borders, now: float
) -> Two:
    """Two bodies in place of one: the second begins with these points (n,) and the motion T (F, 4, 4); then labels and
    motions of the two in turn. now: misfit of the one body; it is given up early what costs far more."""
    number, least = np.full(len(frames.points), -1), LEAST * frames.n_frames
    number[body.rows] = np.arange(len(body))
    i, j = number[borders.i], number[borders.j]
    inner = (i >= 0) & (j >= 0)
    within, labels, motions = Borders(i[inner], j[inner], borders.cost[inner]), second.astype(np.int64), [body.T, T]
    two: list[Body] = []
    for _ in range(ROUNDS):
        before = labels
        for k in range(INNER):
            if min(len(labels) - labels.sum(), labels.sum()) < least:
                return nothing(body)
            two = [make_body(frames, body.rows[labels == p], motions[p]) for p in (0, 1)]
            if k == 0:
                two = [register(frames, canonical, each, SCALES) for each in two]
                motions = [each.T for each in two]
            cost = np.stack([misfits(*each.carry(frames, body.rows), each, frames.noise) for each in two], axis=1)
            labels = expand(cost, expand(cost, labels, within, 1), within, 0)
        value = cost[np.arange(len(labels)), labels].sum() + within.between(labels)
        if value > now + HOPELESS * price(frames):
            return nothing(body)
        if np.mean(labels != before) < SETTLED:
            break
    if min(len(labels) - labels.sum(), labels.sum()) < least:
        return nothing(body)
    two = [register(frames, canonical, make_body(frames, body.rows[labels == p], motions[p]), SCALES) for p in (0, 1)]
    misfit = sum(float(own_misfits(each, frames.noise).sum()) for each in two)
    return misfit + within.between(labels), two[0], two[1]
