"""Random lumpy solids about a line: the links of robots that do not exist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.synth.primitives import arc, ball, bar, crosswise, ring, tube, turned
from rearticulate.synth.trajectories import random_directions

Array = NDArray[np.floating]
Rng = np.random.Generator

SIDES = (3, 4, 4, 4, 6, 8, 20, 20)
OUTLINE_POINTS = 9


def flesh(start: Array, end: Array, half: float, rng: Rng, *, solid: bool = False) -> Array:
    """(T, 3, 3) triangles of a random part from `start` to `end` (3,), about `half` metres thick to each side.

    One to three lumps make it asymmetric, so that a cloud shows how it is turned. solid: its middle line is inside.
    """
    along = (end - start) / np.linalg.norm(end - start)
    across = crosswise(along, random_directions(1, rng)[0])
    cores = (_column,) if solid else (_column, _column, _column, _bow, _fork)
    core = cores[rng.integers(len(cores))](start - 0.3 * half * along, end + 0.3 * half * along, half, across, rng)
    return np.concatenate([core, *(_lump(start, end, half, rng) for _ in range(rng.integers(1, 4)))])


def _column(start: Array, end: Array, half: float, across: Array, rng: Rng) -> Array:
    """Straight: a bar, cone, capsule, ellipsoid, barrel, waist or plate of three to many sides."""
    s = np.linspace(0, 1, OUTLINE_POINTS)
    taper = 1 + rng.choice([0.0, rng.uniform(-1, 1)]) * (s - 0.5)
    belly = 1 + rng.choice([0.0, rng.uniform(-0.5, 0.6)]) * np.sin(np.pi * s) ** 2
    tips = np.sin(np.pi * s) ** rng.choice([0.0, 0.3, 1.0])  # flat, rounded, pointed
    flat = rng.choice([1.0, rng.uniform(0.2, 1.0)])
    profile = np.stack([(1 - np.cos(np.pi * s)) / 2, half * taper * belly * tips], axis=1)
    return turned(profile, start, end, sides=int(rng.choice(SIDES)), flat=flat, across=across)


def _bow(start: Array, end: Array, half: float, across: Array, rng: Rng) -> Array:
    """A bent tube."""
    top = (start + end) / 2 + rng.uniform(0.5, 2.5) * half * across
    return tube(arc(start, top, end), half * rng.uniform(0.4, 0.9, 2), sides=int(rng.choice(SIDES)), across=across)


def _fork(start: Array, end: Array, half: float, across: Array, rng: Rng) -> Array:
    """Two cheeks between two blocks."""
    along = (end - start) / np.linalg.norm(end - start)
    block, cheek, wide = half * along, np.array([0.2, 0.7]) * half, rng.uniform(0.7, 1.3) * half
    blocks = [bar(p - block, p + block, (wide, half), sides=4, across=across) for p in (start + block, end - block)]
    cheeks = [bar(start + d, end + d, cheek, sides=4, across=across) for d in (wide * across, -wide * across)]
    return np.concatenate(blocks + cheeks)


def _lump(start: Array, end: Array, half: float, rng: Rng) -> Array:
    """A box, ball, stick, disc or ring somewhere on the line."""
    along = (end - start) / np.linalg.norm(end - start)
    place = start + rng.uniform(0.1, 0.9) * (end - start)
    out = crosswise(along, random_directions(1, rng)[0])
    size = half * rng.uniform(0.4, 1.2, 3)
    kind = rng.integers(5)
    if kind == 0:
        return bar(place, place + (half + size[0]) * out, size[1:], sides=4, across=along)
    if kind == 1:
        return ball(size[0], place + half * out, stretch=rng.uniform(0.5, 2.0), axis=random_directions(1, rng)[0])
    if kind == 2:
        return bar(place, place + half * rng.uniform(1.5, 4.0) * (out + rng.uniform(-1, 1) * along), 0.3 * size[1])
    if kind == 3:
        thick, wide = 0.3 * size[0] * along, half * rng.uniform(1.1, 1.8, 2)
        place = place + 0.5 * size[1] * out
        return bar(place - thick, place + thick, wide, sides=int(rng.choice(SIDES)), across=out)
    return ring(half * rng.uniform(0.8, 1.5), 0.3 * size[0], place + rng.uniform(0, 1) * half * out, along)
