"""A picture of points and lines: points are discs with a depth, shaded by eye-dome lighting (Boucheny 2009), which
needs no normals; lines lie on top of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rearticulate.records import Array, IntArray
from rearticulate.render.camera import Camera

Pixels = NDArray[np.uint8]
SHARP = 2  # pixels are drawn this many times finer, then averaged
SHADE = 18.0  # strength of the shading
WHITE, INK, SOFT = (255, 255, 255), (29, 39, 51), (102, 113, 127)


class Canvas:
    """camera: in pixels of the finished picture."""

    def __init__(self, camera: Camera) -> None:
        width, height = (SHARP * n for n in camera.pixels)
        self._camera, self._size = camera, (width, height)
        self._depth = np.full(width * height, -np.inf)
        self._color = np.full((width * height, 3), 255, dtype=np.uint8)
        self._lines: list[tuple[Array, tuple[int, ...], float]] = []

    def points(self, points: Array, color: Array, size: float = 2.2) -> None:
        """Discs at points (N, 3) of colours (N, 3) or (3,), `size` pixels across."""
        at, depth = self._camera.project(points)
        order = np.argsort(depth)  # near ones last: they stay
        x, y = np.round(SHARP * at[order]).astype(int).T
        depth, color = depth[order], np.broadcast_to(color, points.shape)[order]
        for dx, dy in _disc(SHARP * size / 2):
            self._put(x + dx, y + dy, depth, color)

    def _put(self, x: IntArray, y: IntArray, depth: Array, color: Array) -> None:
        width, height = self._size
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        pixel = y[inside] * width + x[inside]
        nearer = depth[inside] > self._depth[pixel]
        self._depth[pixel[nearer]] = depth[inside][nearer]
        self._color[pixel[nearer]] = color[inside][nearer]

    def line(self, points: Array, color: tuple[int, ...], width: float = 1.6) -> None:
        """A line through points (K, 3), `width` pixels wide, in front of all points."""
        self._lines.append((SHARP * self._camera.project(points)[0], color, SHARP * width))

    def cross(self, point: Array, color: tuple[int, ...], size: float = 5.0) -> None:
        """A cross at a point (3,), `size` pixels to each side."""
        x, y = SHARP * self._camera.project(point)[0]
        half = SHARP * size
        self._lines.append((np.array([[x - half, y - half], [x + half, y + half]]), color, 2.0 * SHARP))
        self._lines.append((np.array([[x - half, y + half], [x + half, y - half]]), color, 2.0 * SHARP))

    def picture(self) -> Image.Image:
        """What was drawn, on white."""
        width, height = self._size
        depth = self._depth.reshape(height, width)
        color = self._color.reshape(height, width, 3) * eye_dome(depth, SHARP)[..., None]
        image = Image.fromarray(np.round(color).astype(np.uint8))
        pen = ImageDraw.Draw(image)
        for points, shade, thick in self._lines:
            pen.line([tuple(p) for p in points], fill=shade, width=round(thick), joint="curve")
        return image.reduce(SHARP)


def _disc(radius: float) -> list[tuple[int, int]]:
    reach = int(radius)
    cells = [(dx, dy) for dx in range(-reach, reach + 1) for dy in range(-reach, reach + 1)]
    return [(dx, dy) for dx, dy in cells if dx * dx + dy * dy <= radius * radius]


def eye_dome(depth: Array, step: int) -> Array:
    """(h, w) brightness from depth towards the eye, -inf where nothing is: dark where neighbours stand out in front.

    The picture's rim counts as empty."""
    padded = np.pad(depth, step, constant_values=-np.inf)
    h, w = depth.shape
    behind = np.zeros_like(depth)
    known = np.isfinite(depth)
    for dx, dy in ((-step, 0), (step, 0), (0, -step), (0, step)):
        other = padded[step + dy : step + dy + h, step + dx : step + dx + w]
        both = known & np.isfinite(other)
        behind[both] += np.clip(other[both] - depth[both], 0.0, 0.1)
    return np.where(known, 0.35 + 0.65 * np.exp(-SHADE * behind / 4), 1.0)


def caption(image: Image.Image, text: str, height: int = 22, color: tuple[int, ...] = SOFT) -> Image.Image:
    """The picture with a line of text below."""
    out = Image.new("RGB", (image.width, image.height + height), WHITE)
    out.paste(image, (0, 0))
    font = ImageFont.load_default(size=13)
    ImageDraw.Draw(out).text((image.width / 2, image.height + height / 2 - 2), text, fill=color, font=font, anchor="mm")
    return out


def row(images: list[Image.Image]) -> Image.Image:
    """Pictures of one height side by side."""
    out = Image.new("RGB", (sum(i.width for i in images), images[0].height), WHITE)
    x = 0
    for image in images:
        out.paste(image, (x, 0))
        x += image.width
    return out
