"""Things for the hand: pliers, scissors, folding knives, switchboards."""

from __future__ import annotations

import numpy as np

from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.furniture.hardware import LARGEST, NOTHING, Array, Rng, X, Y, Z, add_knob
from rearticulate.synth.primitives import arc, ball, bar, block, ring, tube, turned


def pliers(rng: Rng) -> ArticulatedObject:
    """Two crossed levers on one pivot, with jaws or blades, with or without finger rings and a clasp."""
    jaw, grip, thin = rng.uniform((0.05, 0.1, 0.01), (0.5, 0.6, 0.03))
    deep, rings, wide = thin * rng.choice([0.4, 1.0, 4.0]), rng.random() < 0.4, thin * rng.uniform(0.6, 2.0)
    halves: list[Array] = []
    for side in (1, -1):
        pivot = -0.5 * side * deep * Y
        tip, end = pivot + 0.15 * side * jaw * X + jaw * Z, pivot + 0.4 * side * grip * X - grip * Z
        outline = [(0, thin), (1, rng.uniform(0.2, 1) * thin)]
        blade = turned(outline, pivot, tip, sides=4, flat=deep / thin / 2, across=X)
        bend = arc(pivot, (pivot + end) / 2 + side * rng.uniform(0, 0.2) * grip * X, end)
        loop = ring(3 * thin, 0.6 * thin, end - 3 * thin * Z, Y) if rings else NOTHING
        halves.append(np.concatenate([blade, tube(bend, (wide, deep / 2), sides=8, across=X), loop]))
    build = ObjectBuilder("left", np.concatenate([halves[0], bar(-deep * Y, deep * Y, 1.2 * thin)]))
    build.add("right", halves[1], 0, "revolute", axis=Y, limits=(-0.35, rng.uniform(0.2, 1.0)))
    if rng.random() < 0.3:
        at, out = -0.1 * grip * Z, -1.5 * deep * Y
        clasp = np.concatenate([bar(at + out, at + out - 0.4 * grip * Z, 0.6 * thin), bar(at, at + out, thin)])
        build.add("clasp", clasp, 0, "revolute", axis=Y, point=at, limits=(-0.6, 0.6))
    return build.build()


def knife(rng: Rng) -> ArticulatedObject:
    """Flat leaves that turn out of a handle at either end: a folding knife, ruler or key ring."""
    length, wide, thick = rng.uniform((0.1, 0.01, 0.004), (0.4, 0.03, 0.01))
    leaves = int(rng.integers(1, 6))
    front, back = -thick * Y, leaves * thick * Y
    ends = [share * length * Z for share in (0.06, 0.94)]
    cheeks = [bar(y, y + length * Z, (wide, 0.3 * thick), sides=4, across=X) for y in (front, back)]
    pins = [bar(front + end, back + end, 0.4 * wide, sides=8) for end in ends]
    spine = block((0.3 * wide, leaves * thick, 0.6 * length), (-wide, (leaves - 1) * thick / 2, length / 2))
    build = ObjectBuilder("handle", np.concatenate([*cheeks, *pins, spine]))
    for k in range(leaves):
        up = int(rng.integers(2))
        foot, way = k * thick * Y + ends[up], 1 - 2 * up
        outline = np.array([(0, 1), (0.6, 1), (1, rng.uniform(0.05, 1))]) * (1, wide * rng.uniform(0.4, 0.9))
        tip = foot + way * length * rng.uniform(0.5, 0.85) * Z
        blade = turned(outline, foot, tip, sides=4, flat=0.3 * thick / wide, across=X)
        build.add("leaf", blade, 0, "revolute", axis=way * Y, point=foot, limits=(0, rng.uniform(2, 3.1)))
    return build.build()


def controls(rng: Rng) -> ArticulatedObject:
    """Knobs, buttons, sliders and levers in a row on a plate: a switchboard, stove top or mixer."""
    width, depth, thick = rng.uniform((0.2, 0.15, 0.02), (0.8, 0.5, 0.1))
    build = ObjectBuilder("plate", block((width, depth, thick), (0, 0, -thick / 2)))
    count = int(rng.integers(2, LARGEST))
    cell = width / count
    for k in range(count):
        at = np.array([(k + 0.5) * cell - width / 2, rng.uniform(-0.2, 0.2) * depth, 0])
        kind = rng.integers(4)
        if kind == 0:
            add_knob(build, at, Z, rng.uniform(0.2, 0.4) * cell, rng)
        elif kind == 1:
            size = np.r_[rng.uniform(0.4, 0.8, 2) * cell, 0.6 * cell]
            build.add("button", block(size, at), 0, "prismatic", axis=-Z, limits=(0, 0.25 * cell))
        elif kind == 2:
            cap = block(cell * np.array([0.6, 0.3, 0.3]), at + 0.1 * cell * Z)
            surface = np.concatenate([cap, block(cell * np.array([0.05, 0.1, 0.6]), at)])
            build.add("slider", surface, 0, "prismatic", axis=Y, limits=(-0.25 * depth, 0.25 * depth))
        else:
            stick = bar(at, at + rng.uniform(0.5, 1.5) * cell * Z, 0.1 * cell, sides=8)
            surface, axis = np.concatenate([stick, ball(0.2 * cell, at)]), X if rng.random() < 0.7 else Y
            build.add("lever", surface, 0, "revolute", axis=axis, point=at, limits=(-0.8, 0.8))
    return build.build()
