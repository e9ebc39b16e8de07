"""Small analytic articulated objects with exact answers: `record(hinge(), frames=6, noise=0.001)`.

Sizes are in metres, about those of household things.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.se3 import exp_se3, hat
from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.surfaces import box, cylinder, moved, open_box
from rearticulate.synth.trajectories import random_directions

Array = NDArray[np.floating]


def hinge() -> ArticulatedObject:
    """Two boxes that turn against each other about the y axis at their common edge (a laptop)."""
    build = ObjectBuilder("base", box((0.4, 0.3, 0.04), (0.2, 0, -0.02)))
    build.add("lid", box((0.36, 0.26, 0.03), (-0.18, 0, 0.02)), 0, "revolute", axis=(0, 1, 0), limits=(-0.2, 2.2))
    return build.build()


def slider() -> ArticulatedObject:
    """A block that slides along a rail, along x."""
    build = ObjectBuilder("rail", np.concatenate([box((1.0, 0.2, 0.05)), box((0.05, 0.3, 0.2), (-0.5, 0, 0.05))]))
    build.add("block", box((0.2, 0.16, 0.12), (0, 0, 0.09)), 0, "prismatic", axis=(1, 0, 0), limits=(-0.35, 0.35))
    return build.build()


def arm(joints: int = 4, *, seed: int = 0) -> ArticulatedObject:
    """A chain of `joints` box-shaped links on a base; no two successive joint axes are parallel."""
    rng = np.random.default_rng(seed)
    build = ObjectBuilder("base", box((0.4, 0.3, 0.1), (0, 0, -0.05)))
    tip, axis = np.zeros(3), np.array([0.0, 0.0, 1.0])
    for j in range(joints):
        end = tip + np.array([0.06 * (-1) ** j, 0.04, 0.3])
        build.add(f"link_{j + 1}", _bone(tip, end), j, "revolute", axis=axis, point=tip, limits=(-1.5, 1.5))
        tip, axis = end, _crosswise(axis, rng)
    return build.build()


def cabinet() -> ArticulatedObject:
    """A carcass with a door on a vertical hinge on the left and a drawer below; both open towards -y."""
    build = ObjectBuilder("carcass", open_box((0.8, 0.5, 1.0), 0.02, (0, 0.25, 0.5)))
    door, edge = box((0.78, 0.02, 0.64), (0, -0.015, 0.66)), (-0.39, -0.015, 0.0)
    build.add("door", door, 0, "revolute", axis=(0, 0, -1), point=edge, limits=(0.0, 1.8))
    build.add("drawer", _drawer((0.72, 0.42, 0.24), (0, 0.2, 0.17)), 0, "prismatic", axis=(0, -1, 0), limits=(0, 0.36))
    return build.build()


def rigid() -> ArticulatedObject:
    """One part without any symmetry: record it with `moving_root=True`."""
    stick = cylinder(0.04, (0, 0, 0), (-0.2, -0.1, 0.3))
    shape = [box((0.5, 0.3, 0.1)), box((0.1, 0.12, 0.4), (0.2, 0.08, 0.2)), stick]
    return ObjectBuilder("body", np.concatenate(shape)).build()


def spinning_rod() -> ArticulatedObject:
    """A round rod that turns about its own axis of symmetry: no point cloud tells its joint value."""
    build = ObjectBuilder("base", box((0.5, 0.3, 0.1), (0, 0, -0.05)))
    build.add("rod", cylinder(0.05, (0.1, 0, 0), (0.1, 0, 0.5)), 0, "revolute", axis=(0, 0, 1), point=(0.1, 0, 0))
    return build.build()


def random_tree(parts: int = 6, *, seed: int = 0, prismatic: float = 0.25) -> ArticulatedObject:
    """A tree of random boxes and cylinders, each hung on the end of a random earlier one; axes at random.

    prismatic: share of prismatic joints (they slide along their own part, as a telescope does).
    """
    rng = np.random.default_rng(seed)
    ends = [np.zeros(3)]
    build = ObjectBuilder("part_0", box(tuple(rng.uniform(0.2, 0.4, 3)), (0, 0, 0)))
    for j in range(1, parts):
        parent = int(rng.integers(max(0, j - 3), j))
        along = random_directions(1, rng)[0]
        start = ends[parent] + (0.2 if parent == 0 else 0.0) * along
        ends.append(start + rng.uniform(0.25, 0.45) * along)
        surface = _bone(start, ends[j]) if rng.random() < 0.6 else cylinder(rng.uniform(0.03, 0.06), start, ends[j])
        if rng.random() < prismatic:
            build.add(f"part_{j}", surface, parent, "prismatic", axis=along, limits=(-0.1, 0.15))
        else:
            axis = _crosswise(along, rng)
            build.add(f"part_{j}", surface, parent, "revolute", axis=axis, point=start, limits=(-1.2, 1.2))
    return build.build()


OBJECTS: dict[str, Callable[[], ArticulatedObject]] = {
    make.__name__: make for make in (hinge, slider, arm, cabinet, rigid, spinning_rod, random_tree)
}


def _bone(start: Array, end: Array) -> Array:
    """A box of 10 x 7 cm across whose long axis goes from `start` to `end` (3,), with a knob on one side."""
    length = float(np.linalg.norm(end - start))
    shape = [box((0.1, 0.07, length)), box((0.05, 0.06, 0.4 * length), (0.06, 0, 0.1 * length))]
    z = (end - start) / length
    turn = np.cross((0, 0, 1), z)
    sine = float(np.linalg.norm(turn))
    axis = turn / sine if sine > 1e-9 else np.array([1.0, 0, 0])
    T = exp_se3(np.concatenate([np.arctan2(sine, z[2]) * axis, np.zeros(3)]))
    T[:3, 3] = (start + end) / 2
    return moved(T, np.concatenate(shape))


def _drawer(size: tuple[float, float, float], centre: tuple[float, float, float]) -> Array:
    """A box open at the top, with a front plate (towards -y) a little larger than itself."""
    upright = exp_se3(np.array([-np.pi / 2, 0, 0, 0, 0, 0]))  # carries the open side -y to +z
    upright[:3, 3] = centre
    tray = moved(upright, open_box((size[0], size[2], size[1]), 0.015))
    front = box((size[0] + 0.04, 0.02, size[2] + 0.05), (centre[0], centre[1] - size[1] / 2 - 0.01, centre[2]))
    return np.concatenate([tray, front])


def _crosswise(direction: Array, rng: np.random.Generator) -> Array:
    """A random unit vector (3,) at right angles to `direction` (3,)."""
    v = hat(direction) @ random_directions(1, rng)[0]
    return v / np.linalg.norm(v)
