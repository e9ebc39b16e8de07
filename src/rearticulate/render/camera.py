"""A camera that looks at an object from outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rearticulate.records import Array

DISTANCE = 4.0  # of the eye from the middle, in radii of the picture
MARGIN = 1.05


@dataclass(frozen=True)
class Camera:
    """R (3, 3): rows right, up and towards the eye. middle (3,): what it looks at. radius: m, to the picture's rim.
    pixels: (width, height)."""

    R: Array
    middle: Array
    radius: float
    pixels: tuple[int, int]

    def project(self, points: Array) -> tuple[Array, Array]:
        """Points (..., 3) -> pixels (..., 2), x right and y down, and the distance towards the eye (...) in radii."""
        seen = (points - self.middle) @ self.R.T / self.radius
        shrink = DISTANCE / (DISTANCE - np.minimum(seen[..., 2], 0.9 * DISTANCE))
        half = min(self.pixels) / 2
        x = self.pixels[0] / 2 + half * shrink * seen[..., 0]
        y = self.pixels[1] / 2 - half * shrink * seen[..., 1]
        return np.stack([x, y], axis=-1), seen[..., 2]


@dataclass(frozen=True)
class View:
    """Where the eye is. azimuth, elevation: degrees. up: the world's axis that points up: "z", "-y"."""

    azimuth: float = 35.0
    elevation: float = 15.0
    up: str = "z"

    @property
    def R(self) -> Array:
        """(3, 3) rows right, up and towards the eye."""
        azimuth, elevation = np.deg2rad([self.azimuth, self.elevation])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        eye = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        return np.stack([right, np.cross(eye, right), eye]) @ upright(self.up)

    def camera(self, clouds: Sequence[Array], pixels: tuple[int, int]) -> Camera:
        """A camera in whose picture the clouds (..., 3) just fit."""
        points = np.concatenate([cloud.reshape(-1, 3) for cloud in clouds])
        seen = points @ self.R.T
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2 @ self.R
        radius = float(np.abs(points - middle).max()) or 1.0
        half = np.array(pixels) / 2
        for _ in range(4):  # what is nearer looks larger, so the radius is found in rounds
            at, _ = Camera(self.R, middle, radius, pixels).project(points)
            radius *= MARGIN * float((np.abs(at - half) / half).max()) or 1.0
        return Camera(self.R, middle, radius, pixels)


def upright(up: str) -> Array:
    """(3, 3) rotation of the world that brings the axis `up` ("z", "-y", ...) to z."""
    sign, axis = (-1.0 if up.startswith("-") else 1.0), "xyz".index(up[-1])
    turns = {0: [[0, 1, 0], [0, 0, 1], [1, 0, 0]], 1: [[0, 0, 1], [1, 0, 0], [0, 1, 0]], 2: np.eye(3)}
    R = np.array(turns[axis], dtype=np.float64)
    return R if sign > 0 else np.diag([1.0, -1.0, -1.0]) @ R
