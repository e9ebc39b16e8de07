"""An articulated object with surfaces, and its recording as a 4D point cloud with ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.kinematics import forward_kinematics
from rearticulate.geometry.se3 import inverse, rotate, transform
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth import surfaces
from rearticulate.synth.trajectories import (
    Start,
    finite_limits,
    random_directions,
    root_walk,
    start_posture,
    sweep,
    uniform_between,
)
from rearticulate.synth.visibility import visible_points

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

_OVERSAMPLING = 6  # surface points drawn for each visible point wanted


@dataclass(frozen=True)
class ArticulatedObject:
    """Parts with surfaces in a kinematic tree. All coordinates are of the rest pose: every q = 0, root at the identity.

    names:      (P,) part names.
    surfaces:   one (T_p, 3, 3) array of triangles a part, metres.
    parent:     (P,) parents come before children; parent[0] = -1.
    joint_type: (P,) "" at the root, else "revolute" or "prismatic".
    axis:       (P, 3) unit, zero at the root. point: (P, 3) a point on the axis.
    limits:     (P, 2) range of q, rad or m; infinite where the joint turns without end; zero at the root.
    leader:     (P,) the joint whose value drives this one (itself unless it mimics): q = gear * q[leader] + offset.
    """

    names: tuple[str, ...]
    surfaces: tuple[Array, ...]
    parent: IntArray
    joint_type: tuple[str, ...]
    axis: Array
    point: Array
    limits: Array
    leader: IntArray
    gear: Array
    offset: Array

    @property
    def n_parts(self) -> int:
        return len(self.parent)

    @property
    def revolute(self) -> NDArray[np.bool_]:
        """(P,) True where the joint turns."""
        return np.array([kind == "revolute" for kind in self.joint_type])

    @property
    def twists(self) -> Array:
        """(P, 6) joint twists (omega, v)."""
        turning, sliding = self.revolute[:, None], np.array([[kind == "prismatic"] for kind in self.joint_type])
        omega = np.where(turning, self.axis, 0.0)
        return np.concatenate([omega, np.cross(self.point, omega) + np.where(sliding, self.axis, 0.0)], axis=1)

    def forward(self, q: Array, T_world_root: Array | None = None) -> Array:
        """T_world_part (..., P, 4, 4) at joint values q (..., P), rad or m."""
        return forward_kinematics(self.parent, self.twists, q, T_world_root)

    def follow(self, q: Array) -> Array:
        """Joint values (..., P) with those of mimicking joints replaced by what their leaders demand."""
        return self.gear * q[..., self.leader] + self.offset


class ObjectBuilder:
    """Adds parts one by one; a part's parent must be there already."""

    def __init__(self, name: str, surface: Array) -> None:
        self._names, self._surfaces, self._parent, self._kinds = [name], [surface], [-1], [""]
        self._axis, self._point, self._limits = [np.zeros(3)], [np.zeros(3)], [np.zeros(2)]
        self._mimic: list[tuple[int, float, float]] = [(0, 1.0, 0.0)]

    def add(self, name: str, surface: Array, parent: int, kind: str, *, axis: Array | tuple[float, float, float],
            point: Array | tuple[float, float, float] = (0, 0, 0), limits: tuple[float, float] = (-np.inf, np.inf),
            mimic: tuple[int, float, float] | None = None) -> int:  # fmt: skip
        """Add a part with surface (T, 3, 3); returns its number. mimic: (leading part, gear, offset)."""
        direction = np.asarray(axis, dtype=np.float64)
        self._names.append(name)
        self._surfaces.append(surface)
        self._parent.append(parent)
        self._kinds.append(kind)
        self._axis.append(direction / np.linalg.norm(direction))
        self._point.append(np.asarray(point, dtype=np.float64))
        self._limits.append(np.asarray(limits, dtype=np.float64))
        self._mimic.append(mimic or (len(self._names) - 1, 1.0, 0.0))
        return len(self._names) - 1

    def build(self) -> ArticulatedObject:
        leader, gear, offset = zip(*self._mimic, strict=True)
        return ArticulatedObject(
            names=tuple(self._names),
            surfaces=tuple(self._surfaces),
            parent=np.array(self._parent, dtype=np.int64),
            joint_type=tuple(self._kinds),
            axis=np.array(self._axis),
            point=np.array(self._point),
            limits=np.array(self._limits),
            leader=np.array(leader, dtype=np.int64),
            gear=np.array(gear, dtype=np.float64),
            offset=np.array(offset, dtype=np.float64),
        )


def record(
    thing: ArticulatedObject,
    *,
    q: Array | None = None,
    T_world_root: Array | None = None,
    frames: int = 10,
    points: int = 4096,
    step_deg: float = 10.0,
    step_m: float | None = None,
    start: Start = "random",
    noise: float = 0.0,
    one_sided: bool = False,
    moving_root: bool = False,
    novel: int = 3,
    seed: int = 0,
) -> tuple[PointSequence, GroundTruth]:
    """Record an object in motion: every frame is sampled afresh, uniformly over the area of all its surfaces.

    q:            (F, P) joint values, rad or m; by default each joint sweeps from `start` at its own step a frame
                  and turns around at its limits. T_world_root: (F, 4, 4), or `moving_root` for a random rigid walk
                  (5 degrees and 1 % of the object's diagonal a frame), else at rest.
    frames:       number of frames (of q, when given). points: points a frame.
    step_deg:     what a revolute joint turns a frame, degrees. step_m: what a prismatic joint slides a frame, metres;
                  by default the share step_deg / 180 of its range.
    noise:        standard deviation of each coordinate, metres.
    one_sided:    keep only what one camera, fixed in a random direction, can see.
    novel:        number of random postures within the limits in the ground truth (root as in frame 0).
    """
    rng = np.random.default_rng(seed)
    if q is None:
        step = _steps(thing, np.deg2rad(step_deg), step_m)
        q = sweep(start_posture(thing.limits, start, rng), thing.limits, step, frames, rng)
    q = thing.follow(np.asarray(q, dtype=np.float64))
    if T_world_root is None:
        walk = root_walk(len(q), _middle(thing, q[0]), rng, step=0.01 * _diagonal(thing, q[0]))
        T_world_root = walk if moving_root else np.broadcast_to(np.eye(4), walk.shape)
    T_world_part = thing.forward(q, T_world_root)
    camera = random_directions(1, rng)[0] if one_sided else None
    clouds, labels = zip(*(_scan(thing, T, points, camera, rng) for T in T_world_part), strict=True)
    noisy = [cloud + noise * rng.normal(size=cloud.shape) for cloud in clouds]
    postures = thing.follow(uniform_between(thing.limits, (novel,), rng))
    T_world_novel = thing.forward(postures, np.broadcast_to(T_world_root[0], (novel, 4, 4)))
    return PointSequence.from_arrays(noisy), _truth(thing, q, labels, T_world_part, T_world_novel)


def record_poses(
    surfaces_of_parts: Sequence[Array], parent: IntArray, T_world_part: Array, *, points: int = 4096, seed: int = 0
) -> tuple[PointSequence, GroundTruth]:
    """Record parts that move in any way: surfaces (T_p, 3, 3) under poses (F, P, 4, 4). The truth knows no joints."""
    rng = np.random.default_rng(seed)
    clouds, labels = zip(*(_sampled(surfaces_of_parts, T, points, rng) for T in T_world_part), strict=True)
    poses = T_world_part @ inverse(T_world_part[0])
    return PointSequence.from_arrays(clouds), GroundTruth(tuple(labels), poses, parent, poses[:0])


def _steps(thing: ArticulatedObject, step: float, step_m: float | None) -> Array:
    """(P,) change of each joint value a frame: rad or m."""
    low, high = finite_limits(thing.limits).T
    slide = (high - low) * step / np.pi if step_m is None else np.full(thing.n_parts, step_m)
    return np.where(thing.revolute, step, slide)


def _scan(
    thing: ArticulatedObject, T: Array, n: int, camera: Array | None, rng: np.random.Generator
) -> tuple[Array, IntArray]:
    """One frame: points (n, 3) and labels (n,) of the parts at poses T (P, 4, 4)."""
    if camera is None:
        return _sampled(thing.surfaces, T, n, rng)
    cloud, labels = _sampled(thing.surfaces, T, _OVERSAMPLING * n, rng)
    seen = visible_points(cloud, camera)
    kept = np.sort(rng.choice(seen, size=min(n, len(seen)), replace=False))
    return cloud[kept], labels[kept]


def _sampled(parts: Sequence[Array], T: Array, n: int, rng: np.random.Generator) -> tuple[Array, IntArray]:
    """Points (n, 3) on the surfaces of the parts at poses T (P, 4, 4), and the part of each (n,)."""
    return surfaces.sample_parts([surfaces.moved(T[p], s) for p, s in enumerate(parts)], n, rng)


def _truth(thing: ArticulatedObject, q: Array, labels, T_world_part: Array, T_world_novel: Array) -> GroundTruth:
    """Ground truth relative to frame 0."""
    T0 = T_world_part[0]
    T_parent = T0[thing.parent.clip(min=0)]
    return GroundTruth(
        labels=tuple(labels),
        poses=T_world_part @ inverse(T0),
        parent=thing.parent,
        novel=T_world_novel @ inverse(T0),
        joint_type=thing.joint_type,
        joint_axis=rotate(T_parent, thing.axis),
        joint_point=transform(T_parent, thing.point) * (thing.parent >= 0)[:, None],
        joint_state=q,
    )


def _corners(thing: ArticulatedObject, q: Array) -> Array:
    """(M, 3) corners of all triangles at joint values q (P,)."""
    moved = [surfaces.moved(T, s).reshape(-1, 3) for T, s in zip(thing.forward(q), thing.surfaces, strict=True)]
    return np.concatenate(moved)


def _middle(thing: ArticulatedObject, q: Array) -> Array:
    corners = _corners(thing, q)
    return (corners.min(axis=0) + corners.max(axis=0)) / 2


def _diagonal(thing: ArticulatedObject, q: Array) -> float:
    return float(np.linalg.norm(np.ptp(_corners(thing, q), axis=0)))
