"""Split: a body becomes two where a second motion explains some of its points so much better that it pays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.observe.body import Body, denials, grown_with, growth, make_body, misfits, register, shares, total
from rearticulate.observe.frames import Frames
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, fresh, own_normals, price
from rearticulate.parts.cuts import Borders, expand, sheet_borders
from rearticulate.search.moves.regions import regions_of, registered
from rearticulate.search.moves.slides import screws, slides
from rearticulate.search.moves.sweep import sweep

Two = tuple[float, Body, Body]  # growth of misfit and borders with two bodies in place of one, and the two

LEAST = 6  # points a frame of each of two bodies
LOOSE = 3.0  # spacings; components are farther apart
NEIGHBOURS = 8
COMPONENTS = 6  # tried, at most
AROUND = 3.0  # spacings; a second body begins with the points that near a region
PROMISE = 0.1  # fall of a point's misfit in a region under a motion of its own that is worth a try
TRIES, INNER = 2, 2
LOCAL = (1.0,) * 4  # strengths of borders, round by round, when a region grows ...
WHOLE = (12.0, 3.0, 1.0, 1.0)  # ... and when whole sheets go
HOPELESS = 4.0  # prices; growth of the score after a round beyond which there are no more
APART, SCALES = (0.8, 0.3), (0.4,)  # robust scales of registrations of components, and of two that were one
SETTLED = 5e-3
MOVES, FEW = 1.0, 100  # spacings; where every body moves farther than this, a part of one may stand still; points asked


def split_bodies(frames: Frames, canonical: int, bodies: Bodies, tried: Bodies = (), sheets: bool = True) -> Bodies:
    """Every body that was not tried and pays as two is two. sheets: also where whole sheets move along a screw,
    or stand still."""
    new, lively = fresh(bodies, tried), all(travel(body) > MOVES for body in bodies)
    borders = sheet_borders(frames, own_normals(bodies, len(frames.points)))

    def parts(body: Body, other: Body | None) -> Bodies:
        """What becomes of one body; what was split may be split again."""
        before = shares(frames, body)
        within = inside(borders, body, len(frames.points))
        motions = slides(canonical, body, frames.noise, screws(body, other), TRIES, price(frames)) if sheets else []
        if sheets and lively and travel(body) > MOVES:
            motions.append(np.tile(np.eye(4), (frames.n_frames, 1, 1)))
        options = [
            by_components(frames, canonical, body, before),
            *by_regions(frames, canonical, body, within, before),
            *by_motions(frames, canonical, body, motions, within, before),
        ]
        cost, first, second = min(options, key=lambda two: two[0])
        if -cost < price(frames):
            return (body,)
        return (*parts(first, second), *parts(second, first))

    def work(p: int) -> Bodies:
        others = [other for q, other in enumerate(bodies) if q != p]
        return parts(bodies[p], max(others, key=len, default=None)) if new[p] else (bodies[p],)

    return tuple(part for found in each(work, range(len(bodies))) for part in found)


def travel(body: Body) -> float:
    """How far the points move from the canonical frame, on average over points and frames."""
    some = body.z[:: max(1, len(body) // FEW)]
    return float(np.linalg.norm(transform(body.T[:, None], some) - some, axis=-1).mean())


def inside(borders: Borders, body: Body, M: int) -> Borders:
    """Those within a body, by numbers of its points."""
    number = np.full(M, -1)
    number[body.rows] = np.arange(len(body))
    i, j = number[borders.i], number[borders.j]
    inner = (i >= 0) & (j >= 0)
    return Borders(i[inner], j[inner], borders.cost[inner])


def nothing(body: Body) -> Two:
    return np.inf, body, body


def components(body: Body) -> Int[Array, " n"]:
    """(n,) of the points, connected by short steps."""
    n = len(body)
    near = nearest(search_tree(body.z), body.z, k=min(NEIGHBOURS, n), within=LOOSE)[1].reshape(n, -1)
    i, k = np.nonzero(near < n)
    return connected_components(coo_matrix((np.ones(len(i)), (i, near[i, k])), shape=(n, n)), directed=False)[1]


def by_components(frames: Frames, canonical: int, body: Body, before: Float[Array, "n G"]) -> Two:
    """The best split of what does not touch the rest of the body, and may turn in itself."""
    component = components(body)
    size, least = np.bincount(component), LEAST * frames.n_frames
    best = nothing(body)
    for q in np.argsort(-size, kind="stable")[:COMPONENTS]:
        second = component == q
        if min(size[q], len(body) - size[q]) >= least:
            halves = [make_body(frames, body.rows[side], body.T) for side in (~second, second)]
            two = [register(frames, canonical, half, APART) for half in halves]
            two[1] = sweep(frames, canonical, two[1])
            cost = more(frames, before, second, two)
            best = min(best, (cost, two[0], two[1]), key=lambda found: found[0])
    return best


def by_regions(frames: Frames, canonical: int, body: Body, within: Borders, before: Float[Array, "n G"]) -> list[Two]:
    """Splits that begin with a region that a motion of its own explains better. before: shares of the body."""
    tries = registered(frames, canonical, body, regions_of(body, canonical))
    out = []
    for found in sorted((one for one in tries if one.gain > PROMISE), key=lambda one: -one.gain)[:TRIES]:
        near = nearest(search_tree(body.z[found.rows]), body.z, within=AROUND)[0] < AROUND
        out.append(separate(frames, canonical, body, near.astype(np.int64), found.T, within, LOCAL, before))
    return out


def by_motions(
    frames: Frames,
    canonical: int,
    body: Body,
    motions: list[Float[Array, "F 4 4"]],
    within: Borders,
    before: Float[Array, "n G"],
) -> list[Two]:
    """Splits that begin with one of several second motions, for whatever is denied less so: whole sheets, since their
    inner points may fit both ways."""
    if not motions:
        return []
    whole, out = stronger(within, WHOLE[0]), []
    first, *others = (denials(make_body(frames, body.rows, T, body), frames.noise) for T in (body.T, *motions))
    for T, second in zip(motions, others, strict=True):
        cost = np.stack([first, second], axis=1)
        labels = np.zeros(len(body), dtype=np.int64)
        for _ in range(INNER):
            labels = both_ways(cost, labels, whole)
        out.append(separate(frames, canonical, body, labels, T, within, WHOLE, before))
    return out


def both_ways(cost: Float[Array, "n 2"], labels: Int[Array, " n"], borders: Borders) -> Int[Array, " n"]:
    """Labels of two after each has taken what it can."""
    return expand(cost, expand(cost, labels, borders, 1), borders, 0)


def stronger(borders: Borders, factor: float) -> Borders:
    return Borders(borders.i, borders.j, factor * borders.cost)


def separate(
    frames: Frames,
    canonical: int,
    body: Body,
    labels: Int[Array, " n"],
    T: Float[Array, "F 4 4"],
    within: Borders,
    strengths: tuple[float, ...],
    before: Float[Array, "n G"],
) -> Two:
    """Two bodies in place of one: they begin with labels (n,), 1 for the second, which moves by T (F, 4, 4); then
    labels and motions of the two in turn, under borders of these strengths. within: borders in the body, by numbers of
    its points. before: shares of the one body; what costs far more is given up early."""
    least, motions = LEAST * frames.n_frames, [body.T, T]
    most = total(before, body.frame, frames.n_frames) + HOPELESS * price(frames)
    two: list[Body] = []
    for strength in strengths:
        last = labels
        for k in range(INNER):
            if min(len(labels) - labels.sum(), labels.sum()) < least:
                return nothing(body)
            last_two = two or [body, body]
            two = [make_body(frames, body.rows[labels == p], motions[p], last_two[p]) for p in (0, 1)]
            if k == 0:
                two = [register(frames, canonical, each, SCALES) for each in two]
                motions = [each.T for each in two]
            cost = np.stack([misfits(*each.carry(frames, body.rows), each, frames.noise) for each in two], axis=1)
            labels = both_ways(cost, labels, stronger(within, strength))
        value = cost[np.arange(len(labels)), labels].sum() + within.between(labels)
        if strength == 1 and value > most:
            return nothing(body)
        if strength == 1 and np.mean(labels != last) < SETTLED:
            break
    if min(len(labels) - labels.sum(), labels.sum()) < least:
        return nothing(body)
    two = [make_body(frames, body.rows[labels == p], motions[p], two[p]) for p in (0, 1)]
    two = [register(frames, canonical, each, SCALES) for each in two]
    return more(frames, before, labels == 1, two) + within.between(labels), two[0], two[1]


def more(frames: Frames, before: Float[Array, "n G"], second: Bool[Array, " n"], two: Sequence[Body]) -> float:
    """By how much the misfit grows, at most, when a body of shares before (n, G) becomes two, second (n,) of its points
    the other one."""
    sides = zip((~second, second), two, strict=True)
    grown = np.concatenate([growth(before[side], shares(frames, half)) for side, half in sides])
    return grown_with(grown, 1)
