"""Where patches go between two frames that lie far apart, proposed by the correspondences of the network."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.kabsch import robust_kabsch
from rearticulate.geometry.nearest import rms_radius
from rearticulate.geometry.se3 import transform
from rearticulate.network.correspond import mutual_matches, point_features
from rearticulate.network.inference import Network, load_network
from rearticulate.network.pyramid import MIN_POINTS
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import Frames

ANCHORS = 8  # matches that a point's motion is interpolated from
OUTLIER = 6.0  # spacings; robust scale of a point against the rigid motion of its patch


class MatchedStarts:
    """The network's features of every frame, made when they are asked for."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._features: dict[int, Float[Array, "_ D"]] = {}

    @cached_property
    def _network(self) -> Network:
        return load_network()

    @cached_property
    def _scale(self) -> float:
        frames = self._frames
        return float(np.mean([rms_radius(frames.points[frames.rows(f)]) for f in range(frames.n_frames)]))

    def possible(self, *frames: int) -> bool:
        """Whether the frames have enough points for the network."""
        return all(len(self._frames.points[self._frames.rows(f)]) >= MIN_POINTS for f in frames)

    def flow(self, a: int, b: int, ratio: float = 1.0) -> SceneFlow:
        """The mutual matches from frame a to frame b; a lower ratio keeps the sure ones (`mutual_matches`)."""
        for f in (a, b):
            if f not in self._features:
                cloud = self._frames.points[self._frames.rows(f)]
                self._features[f] = point_features(self._network, cloud, self._scale)
        x, y = (self._frames.points[self._frames.rows(f)] for f in (a, b))
        i, j = mutual_matches(self._features[a], self._features[b], ratio)
        return SceneFlow(x[i], y[j] - x[i])

    def poses(
        self, T: Float[Array, "K 4 4"], points: Float[Array, "m 3"], patch: Int[Array, " m"], a: int, b: int
    ) -> Float[Array, "K 4 4"]:
        """Patch poses in frame b from those in frame a; points (m, 3) of patches (m,), canonical."""
        here = transform(T[patch], points)
        flow, _ = self.flow(a, b).interpolate(here, ANCHORS)
        return robust_kabsch(here, here + flow, patch, len(T), OUTLIER) @ T
