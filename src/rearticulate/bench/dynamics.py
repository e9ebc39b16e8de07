"""The dynamics gate: an export at rest, its joints over their ranges, its drives under gravity, in every simulator that
is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rearticulate.bench.engines.engine import Engine
from rearticulate.export.clearing import alone, relative, solids
from rearticulate.export.names import joint_name
from rearticulate.export.robot import Robot
from rearticulate.records import Array
from rearticulate.shape.surface import meet

if TYPE_CHECKING:
    import manifold3d

    Surfaces = dict[int, manifold3d.Manifold]  # by the number of the link

SECONDS = 1.0
POSTURES = 100  # at random
MOST_MOVED, MOST_DEEP = 0.01, 1.0  # rad or m; mm
FORMATS = ("urdf", "mjcf", "usd")  # that the gate needs


def _mujoco(path: Path) -> Engine:
    from rearticulate.bench.engines.in_mujoco import MujocoEngine

    return MujocoEngine(path)


def _bullet(path: Path) -> Engine:
    from rearticulate.bench.engines.in_bullet import BulletEngine

    return BulletEngine(path)


def _newton(path: Path) -> Engine:
    from rearticulate.bench.engines.in_newton import NewtonEngine

    return NewtonEngine(path)


ENGINES: dict[str, tuple[Callable[[Path], Engine], str, bool]] = {  # name: engine, suffix of its file, has drives
    "mujoco_urdf": (_mujoco, "urdf", False),
    "mujoco_mjcf": (_mujoco, "xml", True),
    "bullet_urdf": (_bullet, "urdf", False),
    "newton_usd": (_newton, "usdc", True),
}


def gate(robot: Robot, folder: Path) -> dict[str, dict[str, float]]:
    """Measures (see `measure`) by the names of the engines installed. folder: with a URDF, an MJCF and a USD."""
    found, surfaces = {}, solids(robot)
    for name, (load, suffix, driven) in ENGINES.items():
        try:
            engine = load(folder / f"{robot.name}.{suffix}")
        except ModuleNotFoundError:
            continue
        found[name] = measure(engine, robot, surfaces, driven)
    return found


def measure(engine: Engine, robot: Robot, surfaces: Surfaces, driven: bool) -> dict[str, float]:
    """moved: largest change of a joint value in a second without any force, rad or m. depth_mm: deepest contact at
    rest. sweep_mm: deepest one while each joint alone moves over its range; random_mm: at random postures; both without
    links whose surfaces (`solids`) meet there. holds: largest change of a joint value in a second under gravity and
    drives."""
    measures = {
        "moved": engine.run(SECONDS, gravity=False, driven=False),
        "depth_mm": 1000 * max(engine.contacts({}).values(), default=0.0),
        "sweep_mm": 1000 * max((sweep(engine, robot, surfaces, alone(robot, j)) for j in robot.joints), default=0.0),
        "random_mm": 1000 * max((sweep(engine, robot, surfaces, q[None]) for q in random_postures(robot)), default=0.0),
    }
    return {**measures, "holds": engine.run(SECONDS, gravity=True, driven=True)} if driven else measures


def passes(measures: dict[str, float]) -> bool:
    """Whether nothing moves by itself, nothing is pushed apart, and drives hold."""
    still = max(measures["moved"], measures.get("holds", 0.0)) < MOST_MOVED
    return still and max(measures["depth_mm"], measures["sweep_mm"]) < MOST_DEEP


def sweep(engine: Engine, robot: Robot, surfaces: Surfaces, q: Array) -> float:
    """The deepest contact at postures (m, L), each close to the next, m. Links that are no neighbours may be in each
    other where their surfaces meet, or do so at the posture before or after."""
    names = {link.name: j for j, link in enumerate(robot.links)}
    worst = 0.0
    for f in range(len(q)):
        contacts = engine.contacts({joint_name(robot.links[j].name): q[f, j] for j in robot.joints})
        for (a, b), depth in contacts.items():
            if depth > worst and not may_touch(robot, surfaces, names[a], names[b], q[max(f - 1, 0) : f + 2]):
                worst = depth
    return worst


def may_touch(robot: Robot, surfaces: Surfaces, a: int, b: int, q: Array) -> bool:
    """Whether the surfaces of two links that are no neighbours meet at any of the postures (m, L)."""
    if robot.neighbours(a, b):
        return False
    return any(meet(surfaces[a], surfaces[b], T) for T in relative(robot, q, a, b))


def random_postures(robot: Robot) -> Iterator[Array]:
    """(L,) joint values within the limits."""
    rng = np.random.default_rng(1)
    for _ in range(POSTURES):
        q = np.zeros(len(robot.links))
        q[robot.joints] = [rng.uniform(*robot.links[j].limits) for j in robot.joints]
        yield q
