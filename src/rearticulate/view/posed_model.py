"""One model in the viewer: its parts, axes and measured points as nodes of the scene, and the posture they show."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import viser

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import quat_wxyz, transform
from rearticulate.geometry.thin import thinned
from rearticulate.io.palette import part_colors
from rearticulate.posing.fuse import fuse
from rearticulate.records import Array, FitResult, IntArray, PointSequence, Posture
from rearticulate.render.axes import axis_segments
from rearticulate.report.summary import joint_range

BUDGET = 40_000  # points of the model
MEASURED = 8000  # points of one frame
DOT = 2.0  # diameter of a point, in distances to the nearest one
SIGNS = {"revolute": "↻", "prismatic": "↔"}
GHOST = (120, 128, 138)
INK = (29, 39, 51)


class PosedModel:
    """A result and what of it is shown. offset (3,): where it stands, m. Coordinates of points are the result's own."""

    def __init__(
        self, server: viser.ViserServer, name: str, result: FitResult, sequence: PointSequence, offset: Array
    ) -> None:
        self.name, self.result, self.sequence, self.offset = name, result, sequence, offset
        self.model = result.model
        self.posture = Posture.rest(self.model)
        self.frame = self.model.canonical
        self.size = float(np.linalg.norm(np.ptp(self.model.points, axis=0)))
        self._measured_shown = True
        server.scene.add_frame(f"/{name}", show_axes=False, position=offset)
        self._parts = self._add_parts(server)
        self._axes, self._labels = self._add_axes(server)
        self._frames = self._add_frames(server)
        self.show(self.result.motion.posture(self.frame))
        self.show_frame(self.frame)

    @cached_property
    def cloud(self) -> tuple[Array, IntArray]:
        """Points (N, 3) of all frames in the canonical frame, and their parts (N,)."""
        clouds = fuse(self.result, self.sequence)
        points, labels = np.concatenate(clouds), np.repeat(np.arange(len(clouds)), [len(c) for c in clouds])
        rows = thinned(len(points), BUDGET)
        return points[rows], labels[rows]

    def shown_points(self) -> tuple[Array, IntArray]:
        """Points as they are shown, and their parts."""
        points, labels = self.cloud
        return transform(self.T_world_part[labels], points), labels

    @property
    def T_world_part(self) -> Array:
        """(P, 4, 4) of the posture shown."""
        return self.model.forward(self.posture.q, self.posture.T_world_root)

    def show(self, posture: Posture) -> None:
        """Move the parts."""
        self.posture = posture
        T = self.T_world_part
        for node, pose in zip(self._parts, T, strict=True):
            node.position, node.wxyz = pose[:3, 3], quat_wxyz(pose[:3, :3])

    def show_frame(self, frame: int) -> None:
        """The measured points of a frame, and of no other."""
        self.frame = frame
        for f, node in enumerate(self._frames):
            node.visible = self._measured_shown and f == frame

    def show_measured(self, shown: bool) -> None:
        """The measured points, or not."""
        self._measured_shown = shown
        self.show_frame(self.frame)

    def show_part(self, part: int, shown: bool) -> None:
        """The points of a part, or not."""
        self._points[part].visible = shown

    def show_axes(self, shown: bool) -> None:
        """The joint axes, or not."""
        for node in self._axes:
            node.visible = shown

    def show_labels(self, shown: bool) -> None:
        """What the joints are called, and how far they were seen to move, or not."""
        for node in self._labels:
            node.visible = shown

    def shown_parts(self) -> list[bool]:
        """Which parts are shown."""
        return [node.visible for node in self._points]

    def _add_parts(self, server: viser.ViserServer) -> list[viser.FrameHandle]:
        points, labels = self.cloud
        spacing = float(np.median(nearest(search_tree(points), points[::20], k=2)[0][:, 1]))
        colors, frames, self._points = part_colors(self.model.n_parts), [], []
        for p in range(self.model.n_parts):
            path = f"/{self.name}/part_{p}"
            frames.append(server.scene.add_frame(path, show_axes=False))
            own = points[labels == p]
            cloud = server.scene.add_point_cloud(
                f"{path}/points",
                own.astype(np.float32),
                np.tile(colors[p], (len(own), 1)),
                point_size=DOT * spacing,
                point_shape="circle",
                precision="float32",
            )
            self._points.append(cloud)
        return frames

    def _add_axes(self, server: viser.ViserServer) -> tuple[list[viser.LineSegmentsHandle], list[viser.LabelHandle]]:
        """Axes hang on the parts they are fixed to, the parents."""
        rest = np.tile(np.eye(4), (self.model.n_parts, 1, 1))
        lines, labels = [], []
        for segment, j in zip(*axis_segments(self.model, rest), strict=True):
            path = f"/{self.name}/part_{self.model.parent[j]}/axis_{j}"
            text = f"{SIGNS[self.model.joint_type[j]]} {self.model.names[j]}  {joint_range(self.model, j)}"
            lines.append(
                server.scene.add_line_segments(
                    path, segment[None].astype(np.float32), INK, thickness=4.0, thickness_units="screen"
                )
            )
            labels.append(server.scene.add_label(f"{path}_label", text, position=segment[1], font_screen_scale=0.8))
        return lines, labels

    def _add_frames(self, server: viser.ViserServer) -> list[viser.PointCloudHandle]:
        nodes = []
        for f, points in enumerate(self.sequence.points):
            rows = thinned(len(points), MEASURED)
            nodes.append(
                server.scene.add_point_cloud(
                    f"/{self.name}/frame_{f}",
                    points[rows].astype(np.float32),
                    GHOST,
                    point_size=0.003 * self.size,
                    point_shape="square",
                    precision="float32",
                    visible=False,
                )
            )
        return nodes


def on_ray(posed: PosedModel, origin: Array, direction: Array) -> tuple[float, int] | None:
    """The foremost shown point of a model that a ray of the scene (3,), (3,) meets: how far along it, and the row of
    the point in `posed.cloud`; None where it passes by."""
    points, labels = posed.shown_points()
    shown = np.array(posed.shown_parts())[labels]
    along = (points + posed.offset - origin) @ direction
    beside = np.linalg.norm(points + posed.offset - origin - along[:, None] * direction, axis=1)
    hit = np.flatnonzero(shown & (along > 0) & (beside < 0.012 * posed.size))
    if not len(hit):
        return None
    row = int(hit[along[hit].argmin()])
    return float(along[row]), row
