"""What all formats are written from: links with bodies, joints with limits, single-valued joints only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import Bounds, Settings
from rearticulate.export.contacts import pairs_in_touch
from rearticulate.export.names import safe_names
from rearticulate.geometry.kinematics import chain, depth_first
from rearticulate.geometry.se3 import exp_se3
from rearticulate.io.palette import part_colors
from rearticulate.parallel import side_by_side
from rearticulate.pose.fuse import fuse
from rearticulate.pose.single import single_valued
from rearticulate.records import FitResult, KinematicModel, PointSequence
from rearticulate.shape.body import Body, ShapeConfig, make_body

Array = NDArray[np.floating]
Kind = Literal["fixed", "revolute", "continuous", "prismatic"]

Limit = Annotated[float, Bounds(0, 1e9, open=True)]

FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class ExportConfig(Settings):
    """shape: of the bodies. margin: what joints may do beyond their observed range, a share of it on either side.
    floating: the root may move. up: axis against gravity, "x" to "z" or "-x" to "-z". effort (N m or N), velocity
    (rad/s or m/s): limits of every joint, which a scan does not tell. frames_per_second: of the recorded animation."""

    shape: ShapeConfig = field(default_factory=ShapeConfig)
    margin: Annotated[float, Bounds(0, 100)] = 0.1
    floating: bool = False
    up: str = "z"
    frames_per_second: Annotated[float, Bounds(0, 1000, open=True)] = 5.0
    effort: Limit = 100.0
    velocity: Limit = 10.0

    @property
    def up_axis(self) -> Array:
        """(3,) unit."""
        return np.eye(3)["xyz".index(self.up[-1])] * (-1.0 if self.up[0] == "-" else 1.0)


@dataclass(frozen=True)
class Link:
    """A part and its joint to the parent.

    origin: (3,) of the link's frame, canonical coordinates; its axes are those of the canonical frame, so every link
    is at its origin, unturned, where all joint values are 0. kind, axis (3,), limits (low, high; rad or m): of the
    joint. body: in the link's frame; None for the links inside a ball joint. color: (3,) 0 to 255.
    """

    name: str
    parent: int
    origin: Array
    kind: Kind
    axis: Array
    limits: tuple[float, float]
    body: Body | None
    color: NDArray[np.uint8]


@dataclass(frozen=True)
class Robot:
    """name. links: parents before children, the first is the root. floating: the root may move. q: (F, L) joint values
    and T_world_root (F, 4, 4) that were seen. canonical: frame of the rest pose. clouds: (M, 3) points of each part of
    the model in all frames, canonical coordinates."""

    name: str
    links: tuple[Link, ...]
    floating: bool
    q: Array
    T_world_root: Array
    canonical: int
    clouds: tuple[Array, ...]

    @property
    def joints(self) -> list[int]:
        """Links whose joint moves."""
        return [j for j, link in enumerate(self.links) if link.kind != "fixed"]

    @property
    def joints_depth_first(self) -> list[int]:
        """The same, every link with all that is below it before the next one: as nested elements are read."""
        order = depth_first(np.array([link.parent for link in self.links]))
        return [int(j) for j in order if self.links[j].kind != "fixed"]

    @property
    def size(self) -> float:
        """Diagonal of the rest pose, m."""
        return float(np.linalg.norm(np.ptp(np.concatenate(self.clouds), axis=0)))

    def children(self, j: int) -> list[int]:
        return [k for k, link in enumerate(self.links) if link.parent == j]

    def carrier(self, j: int) -> int:
        """The next link above j that has a body; -1 above the root."""
        above = self.links[j].parent
        while above >= 0 and self.links[above].body is None:
            above = self.links[above].parent
        return above

    @cached_property
    def in_touch(self) -> list[tuple[int, int]]:
        """Links with bodies that are neighbours in the tree, or whose convex pieces overlap in a recorded frame."""
        pieces = {j: link.body.pieces for j, link in enumerate(self.links) if link.body is not None}
        return pairs_in_touch(pieces, self.forward(self.q), {(self.carrier(j), j) for j in pieces})

    def forward(self, q: Array, T_world_root: Array | None = None) -> Array:
        """(..., L, 4, 4) frames of all links at joint values q (..., L)."""
        parent = np.array([link.parent for link in self.links])
        origins = np.array([link.origin for link in self.links])
        twists = np.zeros((len(parent), 6))
        for j, link in enumerate(self.links):
            if link.kind != "fixed":
                where = slice(3, 6) if link.kind == "prismatic" else slice(0, 3)
                twists[j, where] = link.axis
        steps = exp_se3(np.asarray(q)[..., None] * twists)
        steps[..., :3, 3] += origins - origins[parent]
        return chain(parent, steps, T_world_root)


def make_robot(result: FitResult, sequence: PointSequence, name: str, config: ExportConfig) -> Robot:
    """Bodies for all parts, three hinges for every ball joint."""
    model, clouds = result.model, fuse(result, sequence)
    single = single_valued(model)
    q = single.hinges(result.motion.q)
    bodies = dict(zip(single.number.tolist(), make_bodies(model, clouds, config.shape), strict=True))
    owner = dict(zip(single.number.tolist(), part_colors(model.n_parts), strict=True))
    names = safe_names(single.model.names)
    links = [
        _link(single.model, k, names[k], q[:, k], bodies.get(k), owner.get(k, np.full(3, 128, dtype=np.uint8)), config)
        for k in range(single.model.n_parts)
    ]
    return Robot(
        name=safe_names([name])[0],
        links=tuple(links),
        floating=config.floating,
        q=q,
        T_world_root=result.motion.T_world_root,
        canonical=model.canonical,
        clouds=clouds,
    )


def _link(
    model: KinematicModel,
    k: int,
    name: str,
    q: Array,
    body: Body | None,
    color: NDArray[np.uint8],
    config: ExportConfig,
) -> Link:
    """One link; its body is brought to its own frame."""
    origin = model.origin[k] if k else np.zeros(3)
    kind, low, high = model.joint_type[k], float(q.min()), float(q.max())
    extra = config.margin * (high - low)
    turns_freely = kind == "revolute" and high - low + 2 * extra >= FULL_TURN
    return Link(
        name=name,
        parent=int(model.parent[k]),
        origin=origin,
        kind="continuous" if turns_freely else kind if kind in ("revolute", "prismatic") else "fixed",
        axis=model.axis[k],
        limits=(low - extra, high + extra),
        body=None if body is None else moved(body, -origin),
        color=color,
    )


def moved(body: Body, shift: Array) -> Body:
    """The body in coordinates whose origin lies at -shift."""
    return replace(
        body,
        surface=body.surface.copy().apply_translation(shift),
        pieces=tuple(piece.copy().apply_translation(shift) for piece in body.pieces),
        centre=body.centre + shift,
    )


def make_bodies(model: KinematicModel, clouds: Sequence[Array], config: ShapeConfig) -> list[Body]:
    """One a part, on all cores, the largest first."""
    size = float(np.linalg.norm(np.ptp(model.points, axis=0))) or 1.0
    order = np.argsort([-len(cloud) for cloud in clouds], kind="stable")
    work = partial(_body, size, config)
    found = side_by_side(work, work, [(clouds[p], model.origin[p]) for p in order])
    return [found[k] for k in np.argsort(order)]


def _body(size: float, config: ShapeConfig, part: tuple[Array, Array]) -> Body:
    return make_body(*part, size=size, config=config)
