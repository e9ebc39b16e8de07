"""What a clip shows, a panel each: what was measured, its parts, the skeleton, the flow of points, a new posture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from PIL import Image

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.geometry.thin import thinned
from rearticulate.io.palette import part_colors
from rearticulate.posing.blend import between_frames, blend
from rearticulate.posing.fuse import fuse
from rearticulate.records import Array, FitResult, IntArray, KinematicModel, PointSequence, Posture
from rearticulate.render.axes import axis_segments
from rearticulate.render.camera import Camera, View
from rearticulate.render.canvas import INK, Canvas, caption

BUDGET = 12_000  # points of one picture
COVER = 2.6  # diameter of a dot, in distances to the nearest point
DOTS = (1.5, 7.0)  # pixels
TRAILS = 160  # points whose paths are drawn
TRAIL = 2.5  # frames
GREY, PALE = np.array([150, 160, 172]), np.array([214, 219, 226])


@dataclass(frozen=True)
class PanelData:
    """What the panels of one clip show. novel: the posture of the last panel. pixels: of one panel."""

    result: FitResult
    sequence: PointSequence
    novel: Posture
    view: View
    pixels: tuple[int, int]

    @cached_property
    def camera(self) -> Camera:
        """One that sees all frames and the new posture."""
        model = self.result.model
        return self.view.camera([*self.sequence.points, model.pose(self.novel.q, self.novel.T_world_root)], self.pixels)

    @cached_property
    def colors(self) -> Array:
        """(P, 3)"""
        return part_colors(self.result.model.n_parts).astype(np.float64)

    @cached_property
    def dense(self) -> tuple[Array, IntArray]:
        """Points of all frames in the rest posture, and their parts."""
        clouds = fuse(self.result, self.sequence)
        points, labels = np.concatenate(clouds), np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
        rows = thinned(len(points), BUDGET)
        return points[rows], labels[rows]

    def cloud(self, f: int) -> tuple[Array, IntArray]:
        """Points and parts of a frame as measured."""
        rows = thinned(len(self.sequence.points[f]), BUDGET)
        return self.sequence.points[f][rows], self.result.labels[f][rows]

    def posed(self, posture: Posture) -> tuple[Array, IntArray]:
        """Points and parts of the model in a posture."""
        points, labels = self.dense
        T = self.result.model.forward(posture.q, posture.T_world_root)
        return transform(T[labels], points), labels

    def dots(self, canvas: Canvas, points: Array, color: Array) -> None:
        """Points (N, 3) as discs that cover the surface."""
        spacing = float(np.median(nearest(search_tree(points), points[::20], k=2)[0][:, 1])) if len(points) > 1 else 0.0
        pixels = COVER * spacing * min(self.pixels) / 2 / self.camera.radius
        canvas.points(points, color, float(np.clip(pixels, *DOTS)))

    def at(self, time: float) -> Posture:
        """The fitted posture at a time, in frames."""
        return between_frames(self.result.motion, np.array([time])).posture(0)


def measured(data: PanelData, time: float, canvas: Canvas) -> None:
    """The points as they came."""
    data.dots(canvas, data.cloud(round(time))[0], GREY)


def parts(data: PanelData, time: float, canvas: Canvas) -> None:
    """The measured points, coloured by part."""
    points, labels = data.cloud(round(time))
    data.dots(canvas, points, data.colors[labels])


def skeleton(data: PanelData, time: float, canvas: Canvas) -> None:
    """The tree: a bone from every joint to the next, and the axes."""
    posture = data.at(time)
    data.dots(canvas, data.posed(posture)[0], PALE)
    draw_skeleton(data.result.model, posture, data.colors, canvas)


def draw_skeleton(model: KinematicModel, posture: Posture, colors: Array, canvas: Canvas) -> None:
    """Bones and axes of a posture."""
    T = model.forward(posture.q, posture.T_world_root)
    own = model.labels == 0
    middle = model.points[own if own.any() else slice(None)].mean(axis=0)
    joints = np.concatenate([transform(T[0], middle)[None], transform(T[model.parent[1:]], model.origin[1:])])
    for j in range(1, model.n_parts):
        canvas.line(joints[[model.parent[j], j]], INK, 1.2)
    draw_axes(model, posture, colors, canvas)


def draw_axes(model: KinematicModel, posture: Posture, colors: Array | None, canvas: Canvas) -> None:
    """The axis of every hinge and slide, in colours of the parts (P, 3) or in ink."""
    segments, joints = axis_segments(model, model.forward(posture.q, posture.T_world_root))
    for segment, j in zip(segments, joints, strict=True):
        canvas.line(segment, INK if colors is None else tuple(int(c) for c in colors[j]), 3.0)


def flow(data: PanelData, time: float, canvas: Canvas) -> None:
    """Where points of the model came from."""
    model = data.result.model
    data.dots(canvas, data.posed(data.at(time))[0], PALE)
    rows = thinned(len(model.points), TRAILS)
    past = between_frames(data.result.motion, np.linspace(max(0.0, time - TRAIL), time, 12))
    T = model.forward(past.q, past.T_world_root)[:, model.labels[rows]]
    for path, part in zip(transform(T, model.points[rows]).swapaxes(0, 1), model.labels[rows], strict=True):
        canvas.line(path, tuple(int(c) for c in data.colors[part]), 1.2)


def new_posture(data: PanelData, time: float, canvas: Canvas) -> None:
    """From the rest posture to one that was never measured."""
    last = max(len(data.sequence) - 1, 1)
    way = blend(Posture.rest(data.result.model), data.novel, np.array([time / last]))
    points, labels = data.posed(way.posture(0))
    data.dots(canvas, points, data.colors[labels])


PANELS: dict[str, tuple[str, Callable[[PanelData, float, Canvas], None]]] = {
    "input": ("measured", measured),
    "parts": ("parts", parts),
    "skeleton": ("joints", skeleton),
    "flow": ("scene flow", flow),
    "pose": ("new posture", new_posture),
}


def draw(data: PanelData, name: str, time: float, title: str | None = None) -> Image.Image:
    """One panel at a time in frames, with its title below."""
    words, panel = PANELS[name]
    canvas = Canvas(data.camera)
    panel(data, time, canvas)
    return caption(canvas.picture(), words if title is None else title)


def novel_posture(model: KinematicModel, seed: int = 0) -> Posture:
    """A posture within the observed ranges that combines what was never seen together."""
    rest, rng = Posture.rest(model), np.random.default_rng(seed)
    q = rest.q.copy()
    for j in range(1, model.n_parts):
        low, high = model.limits[j]
        far = low if abs(low) > abs(high) else high
        if model.joint_type[j] == "spherical":
            turn = rng.normal(size=3)
            q[model.values(j)] = 0.7 * high * turn / np.linalg.norm(turn)
        else:
            q[j] = far if rng.random() < 0.6 else rng.uniform(low, high)
    return Posture(q, rest.T_world_root)
