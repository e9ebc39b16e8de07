"""Things with lids: boxes, chests, pots, trash cans, toilets, laptops, books, suitcases, staplers."""

from __future__ import annotations

import numpy as np

from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.furniture.hardware import NOTHING, Array, Rng, X, Y, Z, handle, sides, tray, upright
from rearticulate.synth.primitives import bar, block, ring, turned
from rearticulate.synth.surfaces import moved


def vessel(rng: Rng) -> ArticulatedObject:
    """A round or square vessel with one or two lids on a hinge at the back, and perhaps a pedal in front."""
    width, depth, height = rng.uniform((0.2, 0.16, 0.2), (0.8, 0.64, 0.8))
    rounded = rng.random() < 0.5
    size = np.array([depth if rounded else width, depth, height])
    back = block((size[0], rng.uniform(0.05, 0.2), rng.uniform(0.3, 0.6)), (0, depth + 0.03, height))
    surface = [_hollow(size, rounded), back if rng.random() < 0.3 else NOTHING]
    build = ObjectBuilder("vessel", np.concatenate(surface))
    level, thick = height, rng.uniform(0.01, 0.05)
    for name in ("seat", "lid")[int(rng.random() < 0.6) :]:
        plate = _cover(np.array([0, depth / 2, level]), size * (1, 1, 0) + thick * Z, rounded, name == "seat", rng)
        point, limits = np.array([0, depth, level]), (0, rng.uniform(1.2, 2.0))
        hinge = bar(point - 0.2 * size[0] * X, point + 0.2 * size[0] * X, 0.025)
        build.add(name, np.concatenate([plate, hinge]), 0, "revolute", axis=-X, point=point, limits=limits)
        level += 1.05 * thick
    if rng.random() < 0.4:
        pedal = block((0.3 * size[0], 0.2, 0.015), (0, 0.05 * depth, 0.05))
        build.add("pedal", pedal, 0, "revolute", axis=X, point=(0, 0.1 * depth, 0.05), limits=(-0.2, 0.3))
    return build.build()


def laptop(rng: Rng) -> ArticulatedObject:
    """Two slabs on one hinge, and sometimes a third one at the side."""
    width, depth, thick = rng.uniform((0.05, 0.15, 0.008), (0.5, 0.4, 0.06))
    slab = block((width, depth, thick), (0, -depth / 2, -thick / 2))
    foot = block((0.3 * width, 0.1 * depth, 0.5 * thick), (0.2 * width, -0.7 * depth, -1.2 * thick))
    pegs = [bar(s - 0.05 * width * X, s + 0.05 * width * X, 0.6 * thick) for s in sides(0.3 * width)]
    build = ObjectBuilder("base", np.concatenate([slab, foot, *pegs[: rng.integers(0, 3)]]))
    size = np.array([width, depth, thick]) * rng.uniform(0.6, 1.1, 3)
    lid = [block(size, (0, -size[1] / 2, size[2] / 2)), block(size * (0.2, 0.2, 1), (0, -0.9 * size[1], size[2]))]
    build.add("lid", np.concatenate(lid), 0, "revolute", axis=-X, limits=(0.0, rng.uniform(1.5, 3.0)))
    if rng.random() < 0.4:
        leaf = block((0.8 * width, depth, thick), (0.9 * width, -depth / 2, -thick / 2))
        build.add("leaf", leaf, 0, "revolute", axis=-Y, point=(width / 2, 0, 0), limits=(0, 2.5))
    return build.build()


def _hollow(size: Array, rounded: bool) -> Array:
    """A vessel of a size (3,) that stands on the ground behind the x axis, open at the top."""
    if not rounded:
        return tray(size[2] / 2 * Z, size)
    profile = np.array([(0, 0.4), (1, 0.5), (1, 0.46), (0.06, 0.37)]) * (1, size[1])
    return turned(profile, (0, size[1] / 2, 0), (0, size[1] / 2, size[2]))


def _cover(at: Array, size: Array, rounded: bool, holed: bool, rng: Rng) -> Array:
    """A flat ring, frame, disc or plate of a size (3,) on `at` (3,); without a hole it has a handle on top."""
    middle = at + size[2] / 2 * Z
    if holed and rounded:
        return ring(0.43 * size[1], 0.06 * size[1], middle, Z)
    if holed:
        wide = [block(size * (1, 0.15, 1), middle + s * 0.425 * size[1] * Y) for s in (-1, 1)]
        return np.concatenate(wide + [block(size * (0.15, 1, 1), middle + s) for s in sides(0.425 * size[0])])
    T = upright()
    T[:3, 3] = at + size[2] * Z
    plate = bar(at, at + size[2] * Z, size[1] / 2) if rounded else block(size, middle)
    return np.concatenate([plate, moved(T, handle(np.zeros(3), X, 0.1, rng))])
