"""What all formats are written from: links with bodies, joints with limits, single-valued joints only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import Bounds, Settings
from rearticulate.geometry.kinematics import chain, depth_first
from rearticulate.geometry.se3 import exp_se3
from rearticulate.shape.body import Body, ShapeConfig

Array = NDArray[np.floating]
Kind = Literal["fixed", "revolute", "continuous", "prismatic"]

Limit = Annotated[float, Bounds(0, 1e9, open=True)]
Loss = Annotated[float, Bounds(0, 1e9)]


@dataclass(frozen=True)
class ExportConfig(Settings):
    """shape: of the bodies. margin: what joints may do beyond their observed range, a share of it on either side.
    floating: the root may move. up: axis against gravity, "x" to "z" or "-x" to "-z". effort (N m or N), velocity
    (rad/s or m/s): limits of every joint; friction (N m or N), damping (N m s/rad or N s/m): of every joint, by default
    small shares of what it carries (`drives`); a scan tells none of them. frames_per_second: of the recorded
    animation."""

    shape: ShapeConfig = field(default_factory=ShapeConfig)
    margin: Annotated[float, Bounds(0, 100)] = 0.1
    floating: bool = False
    up: str = "z"
    frames_per_second: Annotated[float, Bounds(0, 1000, open=True)] = 5.0
    effort: Limit = 100.0
    velocity: Limit = 10.0
    friction: Loss | None = None
    damping: Loss | None = None

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
class Touch:
    """The surfaces of links a and b meet while joint alone moves, from the rest pose, to values (low, high), rad or
    m."""

    a: int
    b: int
    joint: int
    values: tuple[float, float]


@dataclass(frozen=True)
class Robot:
    """name. links: parents before children, the first is the root. floating: the root may move. q: (F, L) joint values
    and T_world_root (F, 4, 4) that were seen. canonical: frame of the rest pose. clouds: (M, 3) points of each part of
    the model in all frames, canonical coordinates. touches: where links that are no neighbours run into each other."""

    name: str
    links: tuple[Link, ...]
    floating: bool
    q: Array
    T_world_root: Array
    canonical: int
    clouds: tuple[Array, ...]
    touches: tuple[Touch, ...] = ()

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

    def below(self, j: int) -> list[int]:
        """Link j and all that it carries."""
        found = [j]
        for k in found:
            found += self.children(k)
        return found

    def above(self, j: int) -> list[int]:
        """Link j and all links between it and the root, the root too."""
        found = [j]
        while (parent := self.links[found[-1]].parent) >= 0:
            found.append(parent)
        return found

    def neighbours(self, a: int, b: int) -> bool:
        """Whether a joint, of whatever kind, is between two links with bodies."""
        return self.carrier(a) == b or self.carrier(b) == a

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
