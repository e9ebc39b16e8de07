"""Surfaces of simple solids as triangles (T, 3, 3) in metres, and area-weighted sampling of any triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from rearticulate.geometry.se3 import transform

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


def box(size: Sequence[float], centre: Sequence[float] = (0, 0, 0)) -> Array:
    """Surface of an axis-aligned box of edge lengths `size`. A thin panel is a box with one small edge."""
    return np.asarray(trimesh.creation.box(size).triangles, dtype=np.float64) + np.asarray(centre, dtype=np.float64)


def cylinder(radius: float, start: Sequence[float] | Array, end: Sequence[float] | Array) -> Array:
    """Closed cylinder (64 sides) with its axis from `start` to `end`."""
    axis = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    return np.asarray(trimesh.creation.cylinder(radius, segment=np.stack(axis), sections=64).triangles)


def open_box(size: Sequence[float], wall: float, centre: Sequence[float] = (0, 0, 0), open_side: int = 1) -> Array:
    """Box with walls of thickness `wall` and its negative side along axis `open_side` missing (a carcass, a drawer)."""
    extent, middle = np.asarray(size, dtype=np.float64), np.asarray(centre, dtype=np.float64)
    walls = []
    for axis in range(3):
        for sign in (-1, 1):
            if (axis, sign) == (open_side, -1):
                continue
            edge, offset = extent.copy(), np.zeros(3)
            edge[axis], offset[axis] = wall, sign * (extent[axis] - wall) / 2
            walls.append(box(list(edge), list(middle + offset)))
    return np.concatenate(walls)


def moved(T: Array, triangles: Array) -> Array:
    """Triangles (T, 3, 3) under a transform (4, 4)."""
    return transform(T, triangles.reshape(-1, 3)).reshape(-1, 3, 3)


def areas(triangles: Array) -> Array:
    """(T,) area of each triangle, square metres."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)


def sample_parts(parts: Sequence[Array], n: int, rng: np.random.Generator) -> tuple[Array, IntArray]:
    """n points spread uniformly over the area of all parts (T_p, 3, 3): points (n, 3) and the part of each (n,)."""
    points, index = sample(np.concatenate(parts), n, rng)
    return points, np.repeat(np.arange(len(parts)), [len(s) for s in parts])[index]


def sample(triangles: Array, n: int, rng: np.random.Generator) -> tuple[Array, IntArray]:
    """n points spread uniformly over the area of triangles (T, 3, 3): points (n, 3) and their triangle (n,)."""
    cumulative = np.cumsum(areas(triangles))
    index = np.searchsorted(cumulative, rng.random(n) * cumulative[-1], side="right").clip(max=len(triangles) - 1)
    u = rng.random((n, 2))
    u = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)  # fold the unit square onto the triangle
    corner = triangles[index]
    return corner[:, 0] + np.einsum("nk,nkd->nd", u, corner[:, 1:] - corner[:, :1]), index.astype(np.int64)
