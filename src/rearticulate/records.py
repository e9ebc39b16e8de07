"""The records that pass between stages.

F frames, N points, P parts. Joint j *is* the joint of part j to its parent, so there is no edge list.
Metres and radians throughout. `T_a_b` maps b-coordinates to a.

Ground truths, models, motions and results are checked when they are made, whoever makes them: array fields may be given
as anything that NumPy takes for an array and become float64 or int64; what cannot be is an InputError of one line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from rearticulate.bounds import CountOrZero, Seed, conform
from rearticulate.errors import InputError
from rearticulate.geometry.kinematics import chain
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.invariants import check_axes, check_kinds, check_limits, check_names, check_tree
from rearticulate.schema import as_array, conform_fields, real, rigid, whole

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
JointType = Literal["floating", "fixed", "revolute", "prismatic", "spherical"]
TRUE_TYPES = ("", *get_args(JointType))  # of a ground truth, "" at the root

_LABELS = whole("N", 0, below="P")
_TRUTH = {"parent": whole("P", -1, below="P"), "poses": rigid("F P 4 4"), "novel": rigid("K P 4 4")}
_TRUE_JOINTS = {"joint_axis": real("P 3"), "joint_point": real("P 3"), "joint_state": real("F P")}
_MODEL = {
    "parent": whole("P", -1, below="P"),
    "axis": real("P 3"),
    "origin": real("P 3"),
    "limits": real("P 2"),
    "points": real("N 3"),
    "labels": _LABELS,
}
_MOTION = {"q": real("F D"), "T_world_root": rigid("F 4 4")}


@dataclass(frozen=True)
class PointSequence:
    """A 4D point cloud: one cloud a frame, sampled afresh, no correspondences.

    points: one (N_f, 3) array a frame, metres. Frames may differ in size.
    index:  one (N_f,) array a frame: the row of each point in its source, after dropped and subsampled points.
    names:  what to call each frame in a message (a file name, or "frame 3").
    source_points: how many points the source of each frame holds, before any were dropped; () where nobody counted.
    origins: one (S, 3) array a frame: where its sensors stood, metres; () where unknown.
    sensor: one (N_f,) array a frame: the row of the sensor that took each point; () where unknown.
    """

    points: tuple[Array, ...]
    index: tuple[IntArray, ...]
    names: tuple[str, ...]
    source_points: tuple[int, ...] = ()
    origins: tuple[Array, ...] = ()
    sensor: tuple[IntArray, ...] = ()

    @staticmethod
    def from_arrays(points: Any, origins: Any = (), sensor: Any = ()) -> PointSequence:
        """Wrap an (F, N, 3) array or a list of (N_f, 3) arrays, without any check (see `io.load_sequence`)."""
        clouds = tuple(np.asarray(p, dtype=np.float64) for p in points)
        return PointSequence(
            clouds,
            tuple(np.arange(len(p)) for p in clouds),
            tuple(f"frame {f}" for f in range(len(clouds))),
            origins=tuple(np.asarray(o, dtype=np.float64) for o in origins),
            sensor=tuple(np.asarray(s) for s in sensor),
        )

    def __len__(self) -> int:
        return len(self.points)


def frame_labels(labels: Sequence[Any], P: int) -> tuple[IntArray, ...]:
    """One (N_f,) array of part numbers a frame, checked."""
    if not isinstance(labels, (tuple, list)) and np.ndim(labels) == 0:
        raise InputError(f"labels must be one array of part numbers a frame, not {labels!r}")
    return tuple(as_array(f"labels of frame {f}", frame, _LABELS, {"P": P}) for f, frame in enumerate(labels))


@dataclass(frozen=True)
class GroundTruth:
    """What evaluation knows and the fitter never sees.

    labels: one (N_f,) array a frame: true part of every source point.
    poses:  (F, P, 4, 4) motion of each part from frame 0 to frame f (canonical c to f: poses[f] @ inv(poses[c])).
    parent: (P,) -1 at the root.
    novel:  (K, P, 4, 4) novel poses from frame 0.
    joint_type (P,) of str, joint_axis (P, 3), joint_point (P, 3) in frame-0 coordinates, joint_state (F, P);
    None where the source does not tell.
    """

    labels: Sequence[IntArray]
    poses: Array
    parent: IntArray
    novel: Array
    joint_type: tuple[str, ...] | None = None
    joint_axis: Array | None = None
    joint_point: Array | None = None
    joint_state: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", frame_labels(self.labels, np.size(self.parent)))
        conform_fields(self, _TRUTH, F=len(self.labels))
        check_tree(self.parent, in_order=False)
        if self.joint_type is not None:
            conform_fields(self, _TRUE_JOINTS, F=len(self.labels), P=len(self.parent))
            check_kinds(self.joint_type, TRUE_TYPES, self.parent, at_root="")
            check_axes(self.joint_type, np.asarray(self.joint_axis))

    def motion(self, canonical: int) -> Array:
        """(F, P, 4, 4) motion of every part from the canonical frame to each frame."""
        return self.poses @ inverse(self.poses[canonical])


@dataclass(frozen=True)
class KinematicModel:
    """A rearticulable model. Part frames coincide with the world at the canonical frame.

    canonical:  index of the frame whose cloud defines the rest pose (all q = 0).
    parent:     (P,) parents come before children; parent[0] = -1.
    joint_type: (P,) "floating" at the root, else "fixed", "revolute", "prismatic" or "spherical".
    axis:       (P, 3) unit, canonical coordinates; zero at the root and where the joint is spherical.
    origin:     (P, 3) a point on the axis, the one nearest to the joint's points, canonical coordinates; the centre of
                a spherical joint.
    limits:     (P, 2) observed range of q, rad or m; of the angle where the joint is spherical.
    names:      (P,) unique part names.
    points:     (N, 3) canonical cloud. labels: (N,) part of each canonical point.
    """

    canonical: int
    parent: IntArray
    joint_type: tuple[JointType, ...]
    axis: Array
    origin: Array
    limits: Array
    names: tuple[str, ...]
    points: Array
    labels: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "canonical", conform("canonical", self.canonical, CountOrZero))
        conform_fields(self, _MODEL)
        if not len(self.points) or not self.n_parts:
            raise InputError(f"a model needs points and parts, it has {len(self.points)} and {self.n_parts}")
        check_names("part", self.names, self.n_parts)
        check_tree(self.parent)
        check_kinds(self.joint_type, get_args(JointType), self.parent, at_root="floating")
        check_axes(self.joint_type, self.axis)
        check_limits(self.joint_type, self.limits)

    @property
    def n_parts(self) -> int:
        return len(self.parent)

    @property
    def twists(self) -> Array:
        """(P, 6) joint twists (omega, v): (axis, origin x axis) revolute, (0, axis) prismatic, 0 otherwise."""
        twist = np.zeros((self.n_parts, 6))
        for j, kind in enumerate(self.joint_type):
            if kind == "revolute":
                twist[j, :3] = self.axis[j]
                twist[j, 3:] = np.cross(self.origin[j], self.axis[j])
            elif kind == "prismatic":
                twist[j, 3:] = self.axis[j]
        return twist

    @property
    def n_values(self) -> int:
        """Joint values of one posture: one a part, and two more a spherical joint, after those of the parts."""
        return self.n_parts + 2 * self.joint_type.count("spherical")

    def values(self, j: int) -> list[int]:
        """Where the values of joint j stand in q: one number, or the rotation vector (rad) of a spherical joint."""
        if self.joint_type[j] != "spherical":
            return [j]
        more = self.n_parts + 2 * self.joint_type[:j].count("spherical")
        return [j, more, more + 1]

    def forward(self, q: Array, T_world_root: Array | None = None) -> Array:
        """Part poses for joint values (paper eq. 2).

        q: (..., D) rad or m, D = n_values (the root's entry is ignored). T_world_root: (..., 4, 4), identity when
        absent. Returns T_world_part (..., P, 4, 4); the identity for every part at q = 0.
        """
        q = np.asarray(q, dtype=np.float64)
        screws = q[..., : self.n_parts, None] * self.twists
        for j, kind in enumerate(self.joint_type):
            if kind == "spherical":
                turn = q[..., self.values(j)]
                screws[..., j, :] = np.concatenate([turn, np.cross(self.origin[j], turn)], axis=-1)
        return chain(self.parent, exp_se3(screws), T_world_root)

    def pose(self, q: Array, T_world_root: Array | None = None) -> Array:
        """The canonical cloud moved to joint values q (D,): (N, 3)."""
        return transform(self.forward(q, T_world_root)[self.labels], self.points)

    def part_of(self, points: Array) -> IntArray:
        """(M,) part of any point in the canonical frame, by a vote of 3 canonical points. points: (M, 3)."""
        k = min(3, len(self.points))
        distance, index = KDTree(self.points).query(np.asarray(points, dtype=np.float64), k=k)
        distance, index = distance.reshape(-1, k), index.reshape(-1, k)
        votes = np.zeros((len(distance), self.n_parts))
        np.add.at(votes, (np.arange(len(votes))[:, None], self.labels[index]), 1.0 / (distance + 1e-12))
        return votes.argmax(axis=1)


@dataclass(frozen=True)
class Motion:
    """Joint values in every frame: q (F, D) rad or m (see `KinematicModel.values`), zero at the canonical frame;
    T_world_root (F, 4, 4)."""

    q: Array
    T_world_root: Array

    def __post_init__(self) -> None:
        conform_fields(self, _MOTION)

    def posture(self, frame: int) -> Posture:
        """That of one frame."""
        return Posture(self.q[frame], self.T_world_root[frame])


@dataclass(frozen=True)
class Posture:
    """One posture of a model: q (D,) rad or m (see `KinematicModel.values`), T_world_root (4, 4)."""

    q: Array
    T_world_root: Array

    @staticmethod
    def rest(model: KinematicModel) -> Posture:
        """That of the canonical frame."""
        return Posture(np.zeros(model.n_values), np.eye(4))


@dataclass(frozen=True)
class RelaxedModel:
    """The rigid parts of a fit before they are joined: every part moves freely (paper, sec. 3.3.1).

    points: (N, 3) canonical cloud. labels: (N,) part of each point. T_world_part: (F, P, 4, 4), the identity at the
    canonical frame.
    """

    points: Array
    labels: IntArray
    T_world_part: Array


@dataclass(frozen=True)
class JointDiagnostics:
    """How well one joint is known. None: not measured, or without meaning (where a slide is); infinity: unbounded.

    residual:        root mean square point error of the joint's two parts, m.
    observed_range:  max q - min q, rad or m.
    axis_std:        standard deviation of the axis direction, rad. origin_std: of the axis position, m.
    runner_up:       the other joint type, with runner_up_margin = its extra chi-square (large: the type is sure;
                     infinite where the other type would need an axis outside of the object).
    determined:      False when the data do not fix this joint; note says why.
    """

    residual: float | None
    observed_range: float
    axis_std: float | None
    origin_std: float | None
    runner_up: str
    runner_up_margin: float | None
    determined: bool
    note: str = ""


@dataclass(frozen=True)
class StageTime:
    """One line of the time table of a fit."""

    name: str
    seconds: float


@dataclass(frozen=True)
class FitResult:
    """Everything a fit returns.

    labels:   one (N_f,) array a frame: part of every point of the input sequence.
    joints:   one record a part (the root's is empty of meaning).
    energy:   how badly the points are explained. From the direct solver the score a point (`parts.bodies.score`); from
              the paper's E_project + E_group (its supplement), of an object scaled to `deviation.radius`: the two do
              not compare. energies: what canonical frames were chosen by, the lowest first: of the direct solver before
              there are joints.
    residual: (F,) mean distance of the moved canonical points to each frame's points, m; sampling: (F,) what it would
              be for an exact model, for the points of two samples of one surface lie apart. None in older files.
    relaxed:  the parts before they were joined; not kept in files.
    notes:    what a reader must know before the numbers, a sentence each.
    machine:  CPU and linear algebra kernel that it was made on: the same seed gives the same bits on one such pair.
    """

    model: KinematicModel
    motion: Motion
    labels: tuple[IntArray, ...]
    joints: tuple[JointDiagnostics, ...]
    energy: float
    energies: dict[int, float]
    residual: Array
    stages: tuple[StageTime, ...] = ()
    config: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    relaxed: RelaxedModel | None = None
    notes: tuple[str, ...] = ()
    machine: str = ""
    sampling: Array | None = None

    @property
    def misfit(self) -> Array | None:
        """(F,) the residual in excess of the sampling, sqrt(max(0, residual^2 - sampling^2)), m; None if not known."""
        if self.sampling is None:
            return None
        return np.sqrt(np.maximum(self.residual**2 - self.sampling**2, 0.0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", frame_labels(self.labels, self.model.n_parts))
        F, P = len(self.labels), self.model.n_parts
        if self.model.canonical >= F:
            raise InputError(f"the canonical frame is {self.model.canonical}, there are frames 0 to {F - 1}")
        per_frame = ("residual",) if self.sampling is None else ("residual", "sampling")
        conform_fields(self, dict.fromkeys(per_frame, real("F", 0)), F=F)
        shapes = {"q": (F, self.model.n_values), "T_world_root": (F, 4, 4)}
        for name, shape in shapes.items():
            if getattr(self.motion, name).shape != shape:
                found = getattr(self.motion, name).shape
                raise InputError(f"{name} has shape {found}, expected {shape}: the number of frames or parts differs")
        if len(self.joints) != P:
            raise InputError(f"there are diagnostics of {len(self.joints)} joints, expected one of each of {P} parts")
        unknown = [frame for frame in self.energies if frame not in range(F)]
        if unknown:
            raise InputError(f"energies name frame {unknown[0]!r}, there are frames 0 to {F - 1}")
        if not isinstance(self.config, dict):
            raise InputError(f"config must be a dict of settings, not {type(self.config).__name__}")
        conform("seed", self.seed, Seed)
        if not all(isinstance(text, str) for text in (*self.notes, self.machine)):
            raise InputError("notes and machine must be texts")


@dataclass(frozen=True)
class Metric:
    """One reported number. better: empty for a number that is neither good nor bad."""

    key: str
    value: float
    unit: str
    better: Literal["lower", "higher", ""]
