"""Cases with openings: cabinets, wardrobes, dressers, refrigerators, ovens, dishwashers."""

from __future__ import annotations

import numpy as np

from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.furniture.hardware import LARGEST, Array, Rng, X, Y, Z, add_door, add_knob, panel, rack, tray
from rearticulate.synth.primitives import block
from rearticulate.synth.surfaces import open_box


def case(rng: Rng) -> ArticulatedObject:
    """A grid of doors, drawers, flaps, sliding doors and open shelves."""
    width, depth, height = rng.uniform(0.3, 1.6), rng.uniform(0.3, 0.7), rng.uniform(0.4, 1.9)
    foot = rng.choice([0.0, 0.1])
    x = _cuts(width, int(rng.integers(1, 4)), rng) - width / 2
    z = _cuts(height, int(rng.integers(1, 5)), rng) + foot
    build = ObjectBuilder("case", _carcass(x, depth, z, rng))
    cells, last = [(i, j) for i in range(len(x) - 1) for j in range(len(z) - 1)], 0
    for k in rng.permutation(len(cells))[: rng.integers(1, len(cells) + 1)]:
        i, j = cells[k]
        centre = np.array([(x[i] + x[i + 1]) / 2, 0, (z[j] + z[j + 1]) / 2])
        size = np.array([x[i + 1] - x[i], depth, z[j + 1] - z[j]]) - 0.006
        if last < LARGEST - 2:
            last = _close(build, centre, size, rng)
    return build.build()


def oven(rng: Rng) -> ArticulatedObject:
    """A door hinged at the bottom, racks that slide behind it, knobs above it."""
    width, depth, height = rng.uniform(0.4, 0.9), rng.uniform(0.4, 0.7), rng.uniform(0.5, 0.95)
    head = rng.uniform(0.06, 0.2) * height
    room = np.array([width, depth, height - head])
    body = [open_box((width, depth, room[2]), 0.02, (0, depth / 2, room[2] / 2))]
    body += [block((width, depth, head), (0, depth / 2, height - head / 2))]
    build = ObjectBuilder("body", np.concatenate(body))
    add_door(build, room[2] / 2 * Z, room - 0.01, -Z, rng)
    racks = int(rng.integers(1, 4))
    for share in np.linspace(0.25, 0.75, racks):
        size = room * (0.93, 0.85, rng.uniform(0.03, 0.2))
        front = np.array([0, 0.02, share * room[2]])
        surface = rack(front, size, rng) if rng.random() < 0.6 else tray(front, size)
        build.add("rack", surface, 0, "prismatic", axis=-Y, limits=(0, rng.uniform(0.4, 0.75) * depth))
    for k in range(int(rng.integers(0, LARGEST - 1 - racks))):
        place = np.array([(0.12 * k - 0.3) * width, 0, height - head / 2])
        add_knob(build, place, -Y, min(0.3 * head, 0.03), rng)
    return build.build()


def _carcass(x: Array, depth: float, z: Array, rng: Rng) -> Array:
    """Walls between columns that end at x and rows that end at z; legs below, or a top that stands out."""
    width, height, wall = x[-1] - x[0], z[-1] - z[0], rng.uniform(0.01, 0.04)
    middle = (0, depth / 2, (z[0] + z[-1]) / 2)
    walls = [open_box((width, depth, height), wall, middle)]
    walls += [block((wall, depth, height), (c, *middle[1:])) for c in x[1:-1]]
    walls += [block((width, depth, wall), (*middle[:2], c)) for c in z[1:-1]]
    if z[0] > 0:
        corners = [(s * (width / 2 - 0.02), y) for s in (-1, 1) for y in (0.02, depth - 0.02)]
        walls += [block((0.04, 0.04, z[0]), (*corner, z[0] / 2)) for corner in corners]
    if rng.random() < 0.3:
        walls += [block((width + 0.06, depth + 0.04, 0.03), (*middle[:2], z[-1] + 0.015))]
    return np.concatenate(walls)


def _close(build: ObjectBuilder, centre: Array, size: Array, rng: Rng) -> int:
    """Close an opening of a size (3,) about `centre` (3,) by one part, or two; returns the number of the last one."""
    flat = size[2] < 0.5 * size[0]
    kind = "drawer" if flat else rng.choice(["door", "door", "doors", "drawer", "flap", "sliding"])
    if kind == "drawer":
        inside = tray(centre, size * (0.94, rng.uniform(0.6, 0.92), rng.uniform(0.4, 0.9)))
        surface = np.concatenate([inside, panel(centre, size, Z, rng)])
        return build.add("drawer", surface, 0, "prismatic", axis=-Y, limits=(0, rng.uniform(0.4, 0.8) * size[1]))
    side = rng.choice([-1, 1])
    if kind == "sliding":
        surface = panel(centre - side * 0.225 * size[0] * X, size * (0.55, 1, 1), side * X, rng)
        return build.add("sliding_door", surface, 0, "prismatic", axis=side * X, limits=(0, 0.4 * size[0]))
    if kind == "doors":
        add_door(build, centre - side * size[0] / 4 * X, size * (0.49, 1, 1), -side * X, rng)
        return add_door(build, centre + side * size[0] / 4 * X, size * (0.49, 1, 1), side * X, rng)
    return add_door(build, centre, size, side * (Z if kind == "flap" else X), rng)


def _cuts(length: float, pieces: int, rng: Rng) -> Array:
    """(pieces + 1,) ends of random pieces of a length, from 0."""
    ends = np.r_[0, np.cumsum(rng.uniform(0.5, 1.5, pieces))]
    return ends / ends[-1] * length
