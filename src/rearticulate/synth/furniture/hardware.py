"""What recurs on household things: handles, knobs, wheels, trays, racks, hinged panels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.se3 import exp_se3, rotate
from rearticulate.synth.articulated import ObjectBuilder
from rearticulate.synth.primitives import arc, ball, bar, block, ring, tube
from rearticulate.synth.surfaces import moved, open_box

Array = NDArray[np.floating]
Rng = np.random.Generator

LARGEST = 8  # parts of a household thing
X, Y, Z = np.eye(3)
NOTHING = np.zeros((0, 3, 3))


def sides(half: float) -> tuple[Array, Array]:
    """Shifts (3,) to the left and to the right."""
    return -half * X, half * X


def bars(starts: Sequence[Array], way: Array, half: float) -> Array:
    """Parallel bars from each of some places along `way` (3,)."""
    return np.concatenate([bar(start, start + way, half, sides=8) for start in starts])


def handle(at: Array, along: Array, room: float, rng: Rng) -> Array:
    """A grip on a wall that faces -y: a bow, a rail on two posts, a knob, a disc, or none."""
    length, out = room * rng.uniform(0.3, 1.0), rng.uniform(0.02, 0.06)
    a, b, thin = at - length / 2 * along, at + length / 2 * along, rng.uniform(0.005, 0.012)
    kind = rng.integers(5)
    if kind == 0:
        return tube(arc(a, at - out * Y, b), thin, sides=8)
    if kind == 1:
        rail = bar(a - out * Y, b - out * Y, thin * rng.uniform(1, 2), sides=8)
        return np.concatenate([bars([a + 0.1 * (b - a), b - 0.1 * (b - a)], -out * Y, thin), rail])
    if kind == 2:
        return np.concatenate([bar(at, at - out * Y, thin, sides=8), ball(2 * thin, at - out * Y)])
    return bar(at, at - out / 2 * Y, 0.03) if kind == 3 else NOTHING


def panel(centre: Array, size: Array, side: Array, rng: Rng) -> Array:
    """A plate before an opening of a size (3,), with a handle near the edge that lies towards `side` (3,)."""
    thick = rng.uniform(0.01, 0.06)
    plate = block((size[0], thick, size[2]), centre - thick / 2 * Y)
    at = centre - thick * Y + side * size / 2 * rng.uniform(0.5, 0.85)
    along = np.abs(np.cross(side, Y)) if rng.random() < 0.8 else np.abs(side)
    return np.concatenate([plate, handle(at, along, min(0.4, 0.7 * float(along @ size)), rng)])


def add_door(build: ObjectBuilder, centre: Array, size: Array, edge: Array, rng: Rng) -> int:
    """A panel before an opening, hinged at the edge that lies towards `edge` (3,); returns its number."""
    point, limits = centre + edge * size / 2, (0, rng.uniform(1.2, 2.6))
    surface = panel(centre, size, -edge, rng)
    return build.add("door", surface, 0, "revolute", axis=np.cross(edge, Y), point=point, limits=limits)


def add_knob(build: ObjectBuilder, at: Array, out: Array, radius: float, rng: Rng, parent: int = 0) -> int:
    """A disc with a wing, so that one sees it turn, on a wall that faces `out` (3,)."""
    top, side = at + rng.uniform(0.5, 1.5) * radius * out, np.roll(out, 1)
    wing = bar(top - radius * side, top + 1.3 * radius * side, (0.2 * radius, 0.4 * radius), sides=4)
    limits = (-np.inf, np.inf) if rng.random() < 0.3 else (-1.5, 1.5)
    surface = np.concatenate([bar(at, top, radius), wing])
    return build.add("knob", surface, parent, "revolute", axis=out, point=at, limits=limits)


def wheel(centre: Array, axis: Array, radius: float, kind: str, rng: Rng) -> Array:
    """A "disc" with a peg, a "rim" on spokes, or a "propeller"."""
    side, thick = np.roll(axis, 1), 0.1 * radius * axis
    if kind == "disc":
        peg = centre + 0.6 * radius * side
        return np.concatenate([bar(centre - thick, centre + thick, radius),
                               bar(peg - 3 * thick, peg + 3 * thick, 0.15 * radius)])  # fmt: skip
    spokes = int(rng.integers(2, 6))
    away = [rotate(exp_se3(np.r_[2 * np.pi * k / spokes * axis, 0, 0, 0]), side) for k in range(spokes)]
    wide, pitch = (0.25, 0.4) if kind == "propeller" else (0.06, 0.0)
    blades = [bar(centre, centre + radius * d, radius * np.array([wide, 0.03]), sides=4,
                  across=np.cross(d, axis) + pitch * axis) for d in away]  # fmt: skip
    rim = ring(0.95 * radius, 0.06 * radius, centre, axis) if kind == "rim" else NOTHING
    return np.concatenate([bar(centre - 2 * thick, centre + 2 * thick, 0.15 * radius), rim, *blades])


def tray(front: Array, size: Array) -> Array:
    """A box of a size (3,), open at the top; `front` (3,) is the middle of its front."""
    T = upright()
    T[:3, 3] = front + size[1] / 2 * Y
    return moved(T, open_box((size[0], size[2], size[1]), min(0.015, 0.1 * float(size.min()))))


def rack(front: Array, size: Array, rng: Rng) -> Array:
    """A grid of wires as wide and deep as `size` (3,); `front` (3,) is the middle of its front."""
    places = [front + s * size[0] * X for s in np.linspace(-0.5, 0.5, int(rng.integers(4, 12)))]
    rails = [front - size[0] / 2 * X + s * size[1] * Y for s in (0, 0.5, 1)]
    return np.concatenate([bars(places, size[1] * Y, 0.004), bars(rails, size[0] * X, 0.005)])


def upright() -> Array:
    """(4, 4) that turns what faces -y so that it faces up."""
    return exp_se3(np.array([-np.pi / 2, 0, 0, 0, 0, 0]))
