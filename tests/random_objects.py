"""What every random object must be: a tree of parts that hang together wherever their joints stand."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rearticulate.geometry.se3 import transform
from rearticulate.records import Array
from rearticulate.synth.articulated import ArticulatedObject
from rearticulate.synth.surfaces import areas, sample
from rearticulate.synth.trajectories import finite_limits, uniform_between

SAMPLES = 2000  # points a part


def assert_tree(thing: ArticulatedObject) -> None:
    """Parents come first, axes are unit vectors, limits are ordered, every part can be seen."""
    P = thing.n_parts
    assert thing.parent[0] == -1 and (thing.parent[1:] >= 0).all() and (thing.parent[1:] < np.arange(1, P)).all()
    np.testing.assert_allclose(np.linalg.norm(thing.axis[1:], axis=1), 1, atol=1e-12)
    assert (thing.limits[1:, 0] < thing.limits[1:, 1]).all()
    assert set(thing.joint_type[1:]) <= {"revolute", "prismatic"}
    area = np.array([areas(surface).sum() for surface in thing.surfaces])
    assert (area > 2e-4 * area.sum()).all() and np.isfinite(np.concatenate(thing.surfaces)).all()


def assert_connected(thing: ArticulatedObject, seed: int, gap: float = 0.04) -> None:
    """Each part comes within `gap` of the object's size to its parent, at random joint values."""
    rng = np.random.default_rng(seed)
    T = thing.forward(uniform_between(thing.limits, (), rng))
    clouds = [transform(T[p], sample(surface, SAMPLES, rng)[0]) for p, surface in enumerate(thing.surfaces)]
    size = np.ptp(np.concatenate(clouds), axis=0).max()
    for p in range(1, thing.n_parts):
        assert cKDTree(clouds[thing.parent[p]]).query(clouds[p])[0].min() < gap * size, thing.names[p]


def assert_every_joint_moves(thing: ArticulatedObject, least: float = 0.01) -> None:
    """From one limit to the middle, each joint moves some point of its part by `least` of that part's size."""
    low, high = finite_limits(thing.limits).T
    T = thing.forward(np.diag((low + high) / 2 - low)) @ np.linalg.inv(thing.forward(np.zeros(thing.n_parts)))
    for p in range(1, thing.n_parts):
        corners = thing.surfaces[p].reshape(-1, 3)
        shift = np.linalg.norm(transform(T[p, p], corners) - corners, axis=1)
        assert shift.max() > least * np.ptp(corners, axis=0).max(), thing.names[p]


def same_bits(a: ArticulatedObject, b: ArticulatedObject) -> bool:
    """Whether two objects are equal in every number."""
    arrays = [(getattr(a, k), getattr(b, k)) for k in ("parent", "axis", "point", "limits")]
    arrays += list(zip(a.surfaces, b.surfaces, strict=False))
    return a.n_parts == b.n_parts and all(np.array_equal(x, y) for x, y in arrays)


def extent(thing: ArticulatedObject) -> Array:
    """(3,) edge lengths of the bounding box at rest."""
    return np.ptp(np.concatenate(thing.surfaces).reshape(-1, 3), axis=0)
