"""Skins of bars, vessels, tubes and rings as triangles (T, 3, 3) in metres: everything that is lofted along a path.

A cross-section is a regular polygon that is circumscribed about an ellipse: with 4 sides it is a rectangle, with many
it is round.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Vector = Sequence[float] | Array

ROUND = 20  # sides of what looks round


def bar(start: Vector, end: Vector, half: float | Vector, *, sides: int = ROUND, across: Vector | None = None) -> Array:
    """Straight bar from `start` to `end`; half: half-width, or one along `across` and one at right angles to it."""
    return tube([start, end], half, sides=sides, across=across)


def block(size: Vector, centre: Vector) -> Array:
    """Axis-aligned box of edge lengths `size`."""
    middle, up = np.asarray(centre, dtype=np.float64), np.array([0, 0, size[2] / 2])
    return bar(middle - up, middle + up, (size[0] / 2, size[1] / 2), sides=4, across=(1, 0, 0))


def tube(
    path: Sequence[Vector] | Array,
    half: float | Vector | Array,
    *,
    sides: int = ROUND,
    across: Vector | None = None,
    closed: bool = False,
) -> Array:
    """Bar along a path (K, 3), with flat ends or, where `closed`, without any.

    half: half-width (), half-widths (2,) along `across` and at right angles to it, or those of every place (K, 2).
    """
    middle = np.asarray(path, dtype=np.float64)
    step = np.roll(middle, -1, 0) - np.roll(middle, 1, 0) if closed else np.gradient(middle, axis=0)
    tangent = step / np.linalg.norm(step, axis=1, keepdims=True)
    u = np.empty_like(middle)
    u[0] = crosswise(tangent[0], across)
    for k in range(1, len(u)):
        u[k] = crosswise(tangent[k], u[k - 1])
    widths = np.broadcast_to(np.asarray(half, dtype=np.float64), (len(middle), 2))
    rings = _rings(middle, u, np.cross(tangent, u), widths, sides)
    ends = (rings[:1], rings[:0]) if closed else (middle[None, -1:].repeat(sides, 1), middle[None, :1].repeat(sides, 1))
    return _skin(np.concatenate([ends[1], rings, ends[0]]))


def turned(
    profile: Sequence[Vector] | Array,
    start: Vector,
    end: Vector,
    *,
    sides: int = ROUND,
    flat: float = 1.0,
    across: Vector | None = None,
) -> Array:
    """Body turned about the line from `start` to `end`, closed at both ends of its profile.

    profile: (K, 2) share of the way from start to end, and radius there, metres. flat: width at right angles to
    `across`, as a share of the one along it.
    """
    share, radius = np.asarray(profile, dtype=np.float64).T
    share, radius = np.r_[share[0], share, share[-1]], np.r_[0, radius, 0]
    axis = np.asarray(end, dtype=np.float64) - np.asarray(start, dtype=np.float64)
    u = crosswise(axis / np.linalg.norm(axis), across)
    v = np.cross(axis / np.linalg.norm(axis), u)
    middle = np.asarray(start, dtype=np.float64) + share[:, None] * axis
    widths = radius[:, None] * np.array([1.0, flat])
    return _skin(_rings(middle, np.tile(u, (len(share), 1)), np.tile(v, (len(share), 1)), widths, sides))


def ball(radius: float, centre: Vector, *, stretch: float = 1.0, axis: Vector = (0, 0, 1)) -> Array:
    """Sphere of a radius, drawn out along `axis` to `stretch` times its length."""
    angle = np.linspace(0, np.pi, ROUND // 2)
    reach = stretch * radius * np.asarray(axis) / np.linalg.norm(axis)
    profile = np.stack([(1 - np.cos(angle)) / 2, radius * np.sin(angle)], axis=1)
    return turned(profile, np.asarray(centre) - reach, np.asarray(centre) + reach)


def ring(radius: float, thickness: float, centre: Vector, axis: Vector) -> Array:
    """Torus about `axis`; its tube has radius `thickness`."""
    return tube(circle(radius, centre, axis), thickness, sides=8, across=axis, closed=True)


def circle(radius: float, centre: Vector, axis: Vector, points: int = ROUND) -> Array:
    """(points, 3) on a circle about `axis`."""
    axis = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    u = crosswise(axis)
    angle = np.arange(points)[:, None] * 2 * np.pi / points
    return np.asarray(centre) + radius * (np.cos(angle) * u + np.sin(angle) * np.cross(axis, u))


def arc(start: Vector, top: Vector, end: Vector, points: int = 9) -> Array:
    """(points, 3) on the parabola that starts and ends in the given points, bent towards `top` halfway."""
    s = np.linspace(0, 1, points)[:, None]
    start, top, end = (np.asarray(p, dtype=np.float64) for p in (start, top, end))
    return (1 - s) * start + s * end + 4 * s * (1 - s) * (top - (start + end) / 2)


def crosswise(direction: Array, hint: Vector | None = None) -> Array:
    """The unit vector (3,) at right angles to the unit vector `direction` (3,) that is nearest to `hint`."""
    axes = np.eye(3)[np.argsort(np.abs(direction), kind="stable")[:1]]
    candidates = axes if hint is None else np.concatenate([np.asarray(hint, dtype=np.float64)[None], axes])
    for candidate in candidates:
        v = candidate - (candidate @ direction) * direction
        if np.linalg.norm(v) > 1e-6 * np.linalg.norm(candidate):
            return v / np.linalg.norm(v)
    raise ValueError(f"{direction} is not a unit vector")


def _rings(middle: Array, u: Array, v: Array, half: Array, sides: int) -> Array:
    """(K, sides, 3) cross-sections about middles (K, 3), in the planes of u and v (K, 3), of half-widths (K, 2)."""
    angle = (2 * np.arange(sides)[:, None] + 1) * np.pi / sides
    corner = np.concatenate([np.cos(angle), np.sin(angle)], axis=1) / np.cos(np.pi / sides)
    return middle[:, None] + np.einsum("sa,ka,kad->ksd", corner, half, np.stack([u, v], axis=1))


def _skin(rings: Array) -> Array:
    """(T, 3, 3) triangles between neighbouring rings (K, S, 3)."""
    a, b = rings[:-1], rings[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return np.concatenate([np.stack([a, d, c], axis=2), np.stack([a, c, b], axis=2)]).reshape(-1, 3, 3)
