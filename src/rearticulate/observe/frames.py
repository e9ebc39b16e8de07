"""The fitter's private copy of the sequence: centred, in units of the point spacing, in an order of its own.

All lengths inside `fit` are in point spacings, so no threshold depends on the unit or the sampling density.
Points are sorted by their distance from the frame's centroid: permuting or rotating the input changes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numba
import numpy as np
from scipy.spatial import KDTree

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.observe.planes import neighbour_offsets
from rearticulate.observe.views import Views, make_views

NORMAL_NEIGHBOURS = 16
NEIGHBOURS = 12
SURROUNDINGS = 40
NOISE_FLOOR = 0.1  # spacings; surfaces are not known better than this
QUARTILE = 3.14  # standard deviations of a normal distribution in the lower quartile of its absolute value
SAMPLE = 20_000  # points of all frames together that an approximate registration works with


@dataclass(frozen=True)
class Frames:
    """F clouds, stored one after the other.

    points, normals of unknown sign, frame of each point, start (F + 1,): first point of each.
    order: row of each point in the input's concatenated frames. unit: metres a spacing. centre: metres.
    views: what the sensors see of other places, where it is known from where these points were taken.
    """

    points: Float[Array, "M 3"]
    normals: Float[Array, "M 3"]
    frame: Int[Array, " M"]
    start: Int[Array, " _"]
    trees: tuple[KDTree, ...]
    order: Int[Array, " M"]
    unit: float
    centre: Float[Array, " 3"]
    views: Views | None = None

    @property
    def n_frames(self) -> int:
        return len(self.start) - 1

    @property
    def stride(self) -> int:
        """Every stride-th point makes a sample of about `SAMPLE` points."""
        return max(1, len(self.points) // SAMPLE)

    @cached_property
    def neighbours(self) -> Int[Array, "M K"]:
        """Rows of the nearest other points of the same frame, nearest first."""
        return np.concatenate(
            [
                nearest(t, t.data, k=NEIGHBOURS + 1)[1][:, 1:] + s
                for t, s in zip(self.trees, self.start[:-1], strict=True)
            ]
        )

    @cached_property
    def noise(self) -> float:
        """Deviation of points from their surface, in spacings, as far as single frames tell; at least `NOISE_FLOOR`."""
        found = np.concatenate([neighbour_offsets(np.ascontiguousarray(tree.data)) for tree in self.trees])
        return max(NOISE_FLOOR, QUARTILE * float(np.quantile(found, 0.25)) / np.sqrt(2)) if len(found) else NOISE_FLOOR

    @cached_property
    def surroundings(self) -> tuple[Int[Array, "M K"], Float[Array, "M K"]]:
        """Rows of more of them, and their distances; -1 and inf where there are no more."""
        near, distance = (
            np.full((len(self.points), SURROUNDINGS), -1, np.int32),
            np.full((len(self.points), SURROUNDINGS), np.inf, np.float32),
        )
        for f, tree in enumerate(self.trees):
            k = min(SURROUNDINGS, tree.n - 1)
            d, j = nearest(tree, tree.data, k=k + 1)
            near[self.rows(f), :k], distance[self.rows(f), :k] = j[:, 1:] + self.start[f], d[:, 1:]
        return near, distance

    @cached_property
    def offsets(self) -> Float[Array, "M K"]:
        """Distance of each of `neighbours` from the tangent plane of the point."""
        gap = self.points[self.neighbours] - self.points[:, None]
        return np.abs(np.einsum("nki,ni->nk", gap, self.normals))

    def take(self, chosen: Int[Array, " G"]) -> Frames:
        """These frames (in order) alone, in the same unit; `order` still points into all frames of the input."""
        rows = np.flatnonzero(np.isin(self.frame, chosen))
        sizes = np.diff(self.start)[chosen]
        return Frames(
            points=self.points[rows],
            normals=self.normals[rows],
            frame=np.repeat(np.arange(len(chosen)), sizes),
            start=np.concatenate([[0], np.cumsum(sizes)]),
            trees=tuple(self.trees[int(f)] for f in chosen),
            order=self.order[rows],
            unit=self.unit,
            centre=self.centre,
            views=None if self.views is None else self.views.take(chosen),
        )

    def only(self, rows: Int[Array, " k"]) -> Frames:
        """The same frames with these points alone, in ascending order; row k of it is row rows[k] here."""
        frame = self.frame[rows]
        start = np.searchsorted(frame, np.arange(self.n_frames + 1))
        return replace(
            self,
            points=self.points[rows],
            normals=self.normals[rows],
            frame=frame,
            start=start,
            trees=tuple(search_tree(self.points[rows[a:b]]) for a, b in pairwise(start)),
            order=self.order[rows],
        )

    def rows(self, f: int) -> slice:
        """Rows of frame f in the flat arrays."""
        return slice(int(self.start[f]), int(self.start[f + 1]))


def point_spacing(clouds: Sequence[Float[Array, "_ 3"]]) -> float:
    """Median distance to the nearest other point, over all frames."""
    return float(np.median(np.concatenate([nearest(search_tree(p), p, k=2)[0][:, 1] for p in clouds])))


def estimate_normals(
    points: Float[Array, "N 3"], tree: KDTree, neighbours: int = NORMAL_NEIGHBOURS
) -> Float[Array, "N 3"]:
    """Unit normals of unknown sign: smallest principal direction of the nearest points."""
    _, near = nearest(tree, points, k=min(neighbours, tree.n))
    return smallest_direction(tree.data, near)


@numba.njit(cache=True, nogil=True)
def _scatter(points, sets):
    """(N, 3, 3) scatter matrix of the points of each set (N, K) of rows."""
    out = np.zeros((len(sets), 3, 3))
    mean, d, count = np.empty(3), np.empty(3), sets.shape[1]
    for i in range(len(sets)):
        mean[:] = 0.0
        for row in sets[i]:
            for a in range(3):
                mean[a] += points[row, a] / count
        for row in sets[i]:
            for a in range(3):
                d[a] = points[row, a] - mean[a]
                for b in range(a + 1):
                    out[i, a, b] += d[a] * d[b]
    return out


def smallest_direction(points: Float[Array, "M 3"], sets: Int[Array, "N K"]) -> Float[Array, "N 3"]:
    """Direction of least spread of each set of rows of points."""
    return np.linalg.eigh(_scatter(points, sets), UPLO="L")[1][:, :, 0]


def make_frames(
    clouds: Sequence[Float[Array, "_ 3"]],
    neighbours: int = NORMAL_NEIGHBOURS,
    origins: Sequence[Float[Array, "_ 3"]] = (),
    sensor: Sequence[Int[Array, " _"]] = (),
) -> Frames:
    """Normalise the clouds (metres) into `Frames`. origins, sensor: as in a `PointSequence`."""
    unit = point_spacing(clouds)
    centre = np.mean([p.mean(axis=0) for p in clouds], axis=0)
    orders = [np.argsort(np.linalg.norm(p - p.mean(axis=0), axis=1), kind="stable") for p in clouds]
    scaled = [(p[o] - centre) / unit for p, o in zip(clouds, orders, strict=True)]
    start = np.concatenate([[0], np.cumsum([len(p) for p in scaled])])
    trees = tuple(search_tree(p) for p in scaled)
    frames = Frames(
        points=np.concatenate(scaled),
        normals=np.concatenate([estimate_normals(p, t, neighbours) for p, t in zip(scaled, trees, strict=True)]),
        frame=np.repeat(np.arange(len(scaled)), np.diff(start)),
        start=start,
        trees=trees,
        order=np.concatenate([o + s for o, s in zip(orders, start[:-1], strict=True)]),
        unit=unit,
        centre=centre,
    )
    if not origins:
        return frames
    origins = [(each - centre) / unit for each in origins]
    sensor = [each[order] for each, order in zip(sensor, orders, strict=False)]
    return replace(frames, views=make_views(scaled, origins, sensor, frames.noise))
