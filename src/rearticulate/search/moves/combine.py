"""Combine: what other starts found takes the place of what lies there, body by body, where that lowers the score."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rearticulate.geometry.se3 import inverse
from rearticulate.observe.body import Body, alike, grown_with, growth, make_body
from rearticulate.observe.frames import Frames
from rearticulate.parts.bodies import LEAST, Bodies, all_shares, labels_of, own_normals, price
from rearticulate.parts.cuts import Borders, sheet_borders
from rearticulate.parts.relaxed import Relaxed


def combine_bodies(frames: Frames, canonical: int, bodies: Bodies, others: Sequence[Relaxed]) -> Bodies:
    """The bodies, with those of other relaxed models, of any canonical frame, that lower the score."""
    candidates = [
        make_body(frames, rows, model.T[:, p] @ inverse(model.T[canonical, p]))
        for model in others
        for p in range(model.n_parts)
        if len(rows := np.flatnonzero(model.labels == p)) >= LEAST * frames.n_frames
    ]
    M = len(frames.points)
    borders = sheet_borders(frames, own_normals(bodies, M))
    for candidate in sorted(candidates, key=len):
        if any(alike(candidate, body) for body in bodies):
            continue
        after = _with(frames, bodies, candidate, borders)
        if after is not bodies:
            bodies, borders = after, sheet_borders(frames, own_normals(after, M))
    return bodies


def _with(frames: Frames, bodies: Bodies, new: Body, borders: Borders) -> Bodies:
    """The bodies and the new one, which takes its points from them, if that lowers the score; else the bodies.
    borders: between points as the bodies have them."""
    M = len(frames.points)
    taken = np.zeros(M, dtype=bool)
    taken[new.rows] = True
    losers = [body for body in bodies if taken[body.rows].any()]
    rests = [body.take(~taken[body.rows]) for body in losers]
    crumbs = [rest for rest in rests if len(rest) < LEAST * frames.n_frames]
    rests = [rest for rest in rests if len(rest) >= LEAST * frames.n_frames]
    if crumbs:  # what is left of a body that has nearly gone goes with the rest of it
        new = make_body(frames, np.sort(np.concatenate([new.rows, *(crumb.rows for crumb in crumbs)])), new.T)
    kept = tuple(body for body in bodies if not taken[body.rows].any())
    after = (*kept, *rests, new)
    cost = borders.between(labels_of(after, M)) - borders.between(labels_of(bodies, M))
    cost += price(frames) * (len(after) - len(bodies))
    grown = growth(all_shares(frames, losers), all_shares(frames, [*rests, new]))
    cost += grown_with(grown, len(after) - len(bodies))
    return after if cost < 0 else bodies
