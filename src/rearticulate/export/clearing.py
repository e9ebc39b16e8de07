"""The collision pieces of a robot, brought to a gap over all that its joints may do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray

from rearticulate.export.robot import Link, Robot, Touch
from rearticulate.geometry.se3 import inverse
from rearticulate.shape.clearance import Pieces
from rearticulate.shape.convex import Convex
from rearticulate.shape.surface import meet, solid

if TYPE_CHECKING:
    import manifold3d

Array = NDArray[np.floating]

GAP = 1e-3  # between two links, of the object's size
BULLET = 2.5e-3  # ... but no less than this: Bullet puts 1 mm around every convex mesh, m
LARGEST = 1e-2  # ... and no more than this, of the object's size
TURN = np.radians(4.0)  # from one posture that is looked at to the next
SLIDE = 0.02  # ... of the object's size
BALL = 4  # values of the first two hinges of a ball joint that are looked at
NO_PIECES = "its neighbours need all its room: it does not collide"


def cleared(robot: Robot) -> Robot:
    """The robot with pieces that no other link comes near: neighbours over the whole range of the joint between them,
    all others in the recorded frames and while one joint after the other moves over its range from the rest pose.
    Where even the surfaces of two links that are no neighbours meet, at postures that were not recorded, their pieces
    stay as they are, so that they do collide; `touches` of the robot says so."""
    gap = clearance(robot.size)
    surfaces = solids(robot)
    pieces = Pieces({j: _convex(robot.links[j]) for j in surfaces}, gap)
    touches: list[Touch] = []
    for a, b in sorted(combinations(surfaces, 2), key=lambda pair: not robot.neighbours(*pair)):
        if robot.neighbours(a, b):
            for q in neighbour_postures(robot, path(robot, a, b)):
                pieces.clear(a, b, relative(robot, q, a, b))
            continue
        for q in robot.q:
            pieces.clear(a, b, relative(robot, q[None], a, b))
        for j in path(robot, a, b):
            q = alone(robot, j)
            T = relative(robot, q, a, b)
            near = np.asarray(pieces.near(a, b, T).any(axis=(1, 2)))
            touching = np.array([n and meet(surfaces[a], surfaces[b], T_f) for n, T_f in zip(near, T, strict=True)])
            touches += [Touch(a, b, j, (q[k, j], q[m - 1, j])) for k, m in runs(touching)]
            for k, m in runs(~touching):
                pieces.clear(a, b, T[k:m])
    links = tuple(_with_pieces(link, pieces, j) if j in surfaces else link for j, link in enumerate(robot.links))
    return replace(robot, links=links, touches=tuple(touches))


def solids(robot: Robot) -> dict[int, manifold3d.Manifold]:
    """The surfaces of all links with bodies, by the number of the link."""
    return {j: solid(link.body.surface) for j, link in enumerate(robot.links) if link.body is not None}


def clearance(size: float) -> float:
    """Between any two links of an object of a size, m."""
    return min(max(GAP * size, BULLET), LARGEST * size)


def path(robot: Robot, a: int, b: int) -> list[int]:
    """The joints that move one of two links against the other."""
    return [j for j in robot.joints if (j in robot.above(a)) != (j in robot.above(b))]


def relative(robot: Robot, q: Array, a: int, b: int) -> Array:
    """(m, 4, 4) poses of link b in the frame of link a at joint values q (m, L)."""
    T = robot.forward(q)
    return inverse(T[:, a]) @ T[:, b]


def alone(robot: Robot, j: int) -> Array:
    """(m, L) postures in which joint j moves over its range, and all others rest."""
    q = np.zeros((len(values := _values(robot, j)), len(robot.links)))
    q[:, j] = values
    return q


def neighbour_postures(robot: Robot, joints: list[int]) -> Iterator[Array]:
    """All that the joints between two neighbours may do: one, none, or the three hinges of a ball joint; the last one
    moves over its range for each of some values of the others."""
    if not joints:
        yield np.zeros((1, len(robot.links)))
        return
    *others, last = joints
    for values in product(*(np.linspace(*_range(robot, j), BALL) for j in others)):
        q = alone(robot, last)
        q[:, others] = values
        yield q


def _range(robot: Robot, j: int) -> tuple[float, float]:
    return (-np.pi, np.pi) if robot.links[j].kind == "continuous" else robot.links[j].limits


def _values(robot: Robot, j: int) -> Array:
    """The values of a joint that are looked at."""
    low, high = _range(robot, j)
    step = SLIDE * robot.size if robot.links[j].kind == "prismatic" else TURN
    return np.linspace(low, high, int(np.ceil((high - low) / step)) + 1)


def runs(where: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index and the index after the last of all stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where, [0]]).astype(int)))
    return [(int(k), int(m)) for k, m in edges.reshape(-1, 2)]


def _convex(link: Link) -> list[Convex]:
    found = [Convex.around(np.asarray(piece.vertices)) for piece in link.body.pieces] if link.body else []
    return [piece for piece in found if piece is not None]


def _with_pieces(link: Link, pieces: Pieces, j: int) -> Link:
    """The link with what is left of its pieces."""
    assert link.body is not None
    parts = pieces.parts(j)
    body = replace(
        link.body,
        pieces=tuple(trimesh.convex.convex_hull(part.corners) for part in parts),
        cut=pieces.lost(j),
        note=link.body.note if parts else "; ".join(filter(None, [link.body.note, NO_PIECES])),
    )
    return replace(link, body=body)
