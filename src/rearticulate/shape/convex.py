"""Convex bodies, and what a plane leaves of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

Array = NDArray[np.floating]

PROBES = 300  # points in a body by which shares of its volume are estimated
SIDES = 24  # of a body, the largest, that are looked at
SEED = 0


@dataclass(frozen=True, eq=False)
class Convex:
    """corners: (n, 3). faces: (m, 3) triangles of corners. volume: m^3."""

    corners: Array
    faces: NDArray[np.integer]
    volume: float

    @staticmethod
    def around(points: Array) -> Convex | None:
        """The hull of points (n, 3); None where they span no volume."""
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError):
            return None
        number = np.full(len(points), -1)
        number[hull.vertices] = np.arange(len(hull.vertices))
        return Convex(points[hull.vertices], number[hull.simplices], float(hull.volume))

    @cached_property
    def centre(self) -> Array:
        """(3,) of the box around it."""
        return (self.corners.min(axis=0) + self.corners.max(axis=0)) / 2

    @cached_property
    def radius(self) -> float:
        """Of the ball around the centre that holds it, m."""
        return float(np.linalg.norm(self.corners - self.centre, axis=1).max())

    @cached_property
    def normals(self) -> Array:
        """(k, 3) outward unit normals of its largest sides."""
        a, b, c = self.corners[self.faces].swapaxes(0, 1)
        across = np.cross(b - a, c - a)
        across *= np.sign(np.einsum("mi,mi->m", across, a - self.corners.mean(axis=0)))[:, None]
        area = np.linalg.norm(across, axis=1)
        across, area = across[area > 0], area[area > 0]
        rounded, side = np.unique((across / area[:, None]).round(2), axis=0, return_inverse=True)
        largest = np.argsort(-np.bincount(side.reshape(-1), area))[:SIDES]
        return rounded[largest] / np.linalg.norm(rounded[largest], axis=1, keepdims=True)

    @cached_property
    def thickness(self) -> float:
        """The least width across one of its largest sides, m."""
        return float(np.ptp(self.corners @ self.normals.T, axis=0).min())

    @cached_property
    def probes(self) -> Array:
        """(PROBES, 3) points spread evenly over its volume."""
        rng = np.random.default_rng(SEED)
        apex = self.corners.mean(axis=0)
        edges = self.corners[self.faces] - apex  # (m, 3, 3)
        weights = np.abs(np.linalg.det(edges))
        chosen = rng.choice(len(edges), PROBES, p=weights / weights.sum())
        shares = rng.dirichlet(np.ones(4), PROBES)[:, :3]
        return apex + np.einsum("pi,pix->px", shares, edges[chosen])

    def beyond(self, normal: Array, offset: float) -> Convex | None:
        """What of it lies where normal @ x >= offset; None where that spans no volume."""
        side = self.corners @ normal - offset
        if side.min() >= 0:
            return self
        if side.max() <= 0:
            return None
        a, b = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]).T
        a, b = np.concatenate([a, b]), np.concatenate([b, a])
        crosses = (side[a] > 0) & (side[b] < 0)
        a, b = a[crosses], b[crosses]
        share = side[a] / (side[a] - side[b])
        crossing = self.corners[a] + share[:, None] * (self.corners[b] - self.corners[a])
        return Convex.around(np.concatenate([self.corners[side >= 0], crossing]))
