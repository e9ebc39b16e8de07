"""What every frame's sensors can tell of a place: it lies behind what they saw, or they looked through it.

The points that a sensor took make its depth image: the nearest range in each direction. A place beyond all ranges
around its direction is hidden, one before all of them is empty: a ray passed through it. All lengths are in spacings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree

UNKNOWN, HIDDEN, NEAR, EMPTY = range(4)  # of several sensors the highest has the word
WINDOW = 5  # pixels of a spacing; so many hold a point nearly always, while every third pixel alone is empty
TOLERANCE = 1.0  # spacings; sampling and slope within a pixel ...
SURE = 2.5  # ... and so many deviations of the noise
EDGE = 5.0  # pixels; a window of ranges that differ by more spans an edge: no opinion of what lies between them
FIELD = 0.5  # cosine of the angle from the middle of the image within which a sensor sees
MOST = 1024  # pixels along one side; beyond it they are larger
FEWEST = 20  # points that make an image


@dataclass(frozen=True)
class Views:
    """Depth images of V sensors, frame by frame.

    first (F + 1,): first sensor of each frame. axes: rows right, up and forward; focal: pixels a unit of tangent;
    edge: spacings. corner, shape, start: of each image. low, high: least and largest range in the window around each
    pixel, inf and -inf where it is empty. tolerance: spacings.
    """

    first: Int[Array, " _"]
    origin: Float[Array, "V 3"]
    axes: Float[Array, "V 3 3"]
    focal: Float[Array, " V"]
    edge: Float[Array, " V"]
    corner: Int[Array, "V 2"]
    shape: Int[Array, "V 2"]
    start: Int[Array, " V+1"]
    low: Float[Array, " pixels"]
    high: Float[Array, " pixels"]
    tolerance: float

    def classes(self, y: Float[Array, "n 3"], frame: Int[Array, " n"]) -> Int[Array, " n"]:
        """`HIDDEN`, `NEAR`, `EMPTY` or `UNKNOWN`: places y as frames see them."""
        return _classes(
            y, frame, self.first, self.origin, self.axes, self.focal, self.edge, self.corner, self.shape, self.start,
            self.low, self.high, self.tolerance,
        )  # fmt: skip

    def blind(self, y: Float[Array, "n 3"], frame: Int[Array, " n"]) -> Bool[Array, " n"]:
        """Places y of which no sensor of frames tells what is there: hidden or unknown."""
        return np.isin(self.classes(y, frame), (UNKNOWN, HIDDEN))

    def cover(self, y: Float[Array, "n 3"]) -> Float[Array, " F"]:
        """Share of places y that each frame does not hide."""
        F = len(self.first) - 1
        return np.array([np.mean(self.classes(y, np.full(len(y), f)) != HIDDEN) for f in range(F)])

    def take(self, chosen: Int[Array, " G"]) -> Views:
        """Those of these frames (in order) alone."""
        v = _ranges(self.first, chosen)
        pixels = _ranges(self.start, v)
        return Views(
            first=np.concatenate([[0], np.cumsum(np.diff(self.first)[chosen])]),
            origin=self.origin[v],
            axes=self.axes[v],
            focal=self.focal[v],
            edge=self.edge[v],
            corner=self.corner[v],
            shape=self.shape[v],
            start=np.concatenate([[0], np.cumsum(np.diff(self.start)[v])]),
            low=self.low[pixels],
            high=self.high[pixels],
            tolerance=self.tolerance,
        )


def _ranges(first: Int[Array, " m"], chosen: Int[Array, " k"]) -> Int[Array, " n"]:
    """All of first[i] to first[i + 1] for the chosen i."""
    return np.concatenate([np.arange(int(first[i]), int(first[i + 1])) for i in chosen])


@numba.njit(cache=True, nogil=True)
def _classes(y, frame, first, origin, axes, focal, edge, corner, shape, start, low, high, tolerance):
    out, d = np.zeros(len(y), np.int8), np.empty(3)
    for i in range(len(y)):
        for v in range(first[frame[i]], first[frame[i] + 1]):
            for a in range(3):
                d[a] = y[i, a] - origin[v, a]
            r = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            z = axes[v, 2, 0] * d[0] + axes[v, 2, 1] * d[1] + axes[v, 2, 2] * d[2]
            if z <= FIELD * r:
                continue
            s, t = focal[v] / z, axes[v]
            p = int(np.floor(s * (t[0, 0] * d[0] + t[0, 1] * d[1] + t[0, 2] * d[2]))) - corner[v, 0]
            q = int(np.floor(s * (t[1, 0] * d[0] + t[1, 1] * d[1] + t[1, 2] * d[2]))) - corner[v, 1]
            if p < 0 or q < 0 or p >= shape[v, 0] or q >= shape[v, 1]:
                continue
            pixel = start[v] + p * shape[v, 1] + q
            if r > high[pixel] + tolerance:
                found = HIDDEN if high[pixel] > 0 else UNKNOWN
            elif r < low[pixel] - tolerance:
                found = EMPTY
            else:
                found = NEAR if high[pixel] - low[pixel] < edge[v] else UNKNOWN
            out[i] = max(out[i], found)
    return out


@dataclass(frozen=True)
class _Image:
    origin: Float[Array, " 3"]
    axes: Float[Array, "3 3"]
    focal: float
    edge: float
    corner: Int[Array, " 2"]
    low: Float[Array, "width height"]
    high: Float[Array, "width height"]


def _image(origin: Float[Array, " 3"], points: Float[Array, "n 3"], pixel: float) -> _Image | None:
    """Depth image of the points that a sensor took; pixel: its size in the middle, in spacings."""
    forward = np.median(points, axis=0) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()]).astype(np.float64)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right).astype(np.float64), forward])
    d = (points - origin) @ axes.T
    r = np.linalg.norm(d, axis=1)
    inside = d[:, 2] > FIELD * r
    if inside.sum() < FEWEST:
        return None
    d, r = d[inside], r[inside]
    tangent = d[:, :2] / d[:, 2:]
    focal = min(float(np.median(d[:, 2])) / pixel, MOST / float(np.ptp(tangent, axis=0).max()))
    place = np.floor(focal * tangent).astype(np.int64)
    corner = place.min(axis=0) - WINDOW // 2
    near = np.full(place.max(axis=0) - corner + WINDOW // 2 + 1, np.inf)
    np.minimum.at(near, tuple((place - corner).T), r)
    low = minimum_filter(near, WINDOW, mode="constant", cval=np.inf)
    high = maximum_filter(np.where(np.isfinite(near), near, -np.inf), WINDOW, mode="constant", cval=-np.inf)
    return _Image(origin, axes, focal, EDGE * pixel, corner, low, high)


def make_views(
    clouds: Sequence[Float[Array, "_ 3"]],
    origins: Sequence[Float[Array, "_ 3"]],
    sensor: Sequence[Int[Array, " _"]],
    noise: float,
) -> Views | None:
    """Of clouds (N_f, 3) taken from origins (S, 3) a frame, by sensor (N_f,) where it is known: else every sensor took
    every point. None where there is no image. noise: of a range."""
    images, first = [], [0]
    for f, cloud in enumerate(clouds):
        for s, origin in enumerate(origins[f]):
            points = cloud[sensor[f] == s] if sensor else cloud
            if len(points) < FEWEST:
                continue
            pixel = max(1.0, float(np.median(nearest(search_tree(points), points, k=2)[0][:, 1])))
            image = _image(origin, points, pixel)
            images += [] if image is None else [image]
        first.append(len(images))
    if not images:
        return None
    return Views(
        first=np.array(first),
        origin=np.stack([each.origin for each in images]),
        axes=np.stack([each.axes for each in images]),
        focal=np.array([each.focal for each in images]),
        edge=np.array([each.edge for each in images]),
        corner=np.stack([each.corner for each in images]),
        shape=np.array([each.low.shape for each in images]),
        start=np.concatenate([[0], np.cumsum([each.low.size for each in images])]),
        low=np.concatenate([each.low.ravel() for each in images]),
        high=np.concatenate([each.high.ravel() for each in images]),
        tolerance=TOLERANCE + SURE * noise,
    )
