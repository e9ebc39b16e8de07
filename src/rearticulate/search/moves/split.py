"""Split: a body becomes two where a second motion explains some of its points so much better that it pays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from rearticulate.geometry.nearest import farthest_points, nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.observe.body import Body, make_body, misfits, own_misfits, register
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import Schedule, fit_cost, register_bodies
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, fresh, own_normals, price
from rearticulate.parts.cuts import Borders, expand, sheet_borders

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
Two = tuple[float, Body, Body]  # misfit and border of two bodies in place of one, and the two

LEAST = 6  # points a frame of each of two bodies
LOOSE = 3.0  # spacings; components are farther apart
NEIGHBOURS = 8
COMPONENTS = 6  # tried, at most
PER_REGION, REGIONS = 50, (4, 14)  # canonical points of a body for each region that is tried, and how many
SHARE, SIZES = 0.2, (30, 120)  # of a body's canonical points in a region, and how many
AROUND = 3.0  # spacings; a second body begins with the points that near a region
PROMISE = 0.1  # fall of a point's misfit in a region under a motion of its own that is worth a try
TRIES, ROUNDS, INNER = 2, 4, 2
REGION = Schedule(iterations=8, sigma=1.5, sigma_end=0.3)
APART, SCALES = (0.8, 0.3), (0.4,)  # robust scales of registrations of components, and of two that were one
SETTLED = 5e-3


def split_bodies(frames: Frames, canonical: int, bodies: Bodies, tried: Bodies = ()) -> Bodies:
    """Every body that was not tried and pays as two is two."""
    new = fresh(bodies, tried)
    borders = sheet_borders(frames, own_normals(bodies, len(frames.points)))

    def ways(p: int) -> tuple[Body, ...]:
        body = bodies[p]
        if not new[p]:
            return (body,)
        options = [by_components(frames, canonical, body), *by_regions(frames, canonical, body, borders)]
        cost, first, second = min(options, key=lambda two: two[0])
        gain = float(own_misfits(body, frames.noise).sum()) - cost
        return (first, second) if gain > price(frames) else (body,)

    return tuple(part for parts in each(ways, range(len(bodies))) for part in parts)


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


def by_regions(frames: Frames, canonical: int, body: Body, borders: Borders) -> list[Two]:
    """Splits that begin with a region that a motion of its own explains better."""
    here = np.flatnonzero(body.frame == canonical)
    if len(here) < 2 * SIZES[0]:
        return []
    size = int(np.clip(SHARE * len(here), *SIZES))
    tree = search_tree(body.z[here])
    seeds = body.z[here][farthest_points(body.z[here], int(np.clip(len(here) / PER_REGION, *REGIONS)))]
    regions = here[nearest(tree, seeds, k=size)[1]]
    T, gains = region_motions(frames, canonical, body, regions)
    out = []
    for r in np.argsort(-gains, kind="stable")[:TRIES]:
        if gains[r] < PROMISE:
            break
        second = nearest(search_tree(body.z[regions[r]]), body.z, within=AROUND)[0] < AROUND
        out.append(separate(frames, canonical, body, second, T[r], borders))
    return out


def region_motions(frames: Frames, canonical: int, body: Body, regions: IntArray) -> tuple[Array, Array]:
    """Regions (R, n) of canonical points, each registered to the body's points of every frame: motions (R, F, 4, 4) and
    by how much the misfit of a point falls (R,)."""
    R, F = len(regions), frames.n_frames
    D, gain = np.tile(np.eye(4), (R, F, 1, 1)), np.zeros(R)
    points, owner = regions.ravel(), np.repeat(np.arange(R), regions.shape[1])
    x, nx = body.z[points], body.normals[points]
    for f in range(F):
        there = np.flatnonzero(body.frame == f)
        if f == canonical or len(there) < NEIGHBOURS:
            continue
        tree, normals = search_tree(body.z[there]), body.normals[there]
        D[:, f] = register_bodies(tree, normals, x, nx, owner, D[:, f], REGION)
        y = transform(D[owner, f], x)
        gain += (fit_cost(tree, normals, x, nx) - fit_cost(tree, normals, y, nx)).reshape(R, -1).mean(axis=1)
    return body.T @ D, gain / (F - 1)


def separate(frames: Frames, canonical: int, body: Body, second: NDArray[np.bool_], T: Array, borders: Borders) -> Two:
    """Two bodies in place of one: the second begins with these points (n,) and the motion T (F, 4, 4); then labels and
    motions of the two in turn."""
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
        if np.mean(labels != before) < SETTLED:
            break
    if min(len(labels) - labels.sum(), labels.sum()) < least:
        return nothing(body)
    two = [register(frames, canonical, make_body(frames, body.rows[labels == p], motions[p]), SCALES) for p in (0, 1)]
    misfit = sum(float(own_misfits(each, frames.noise).sum()) for each in two)
    return misfit + within.between(labels), two[0], two[1]
