"""Models and fits made from ground truth: what a perfect fitter would return."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rearticulate.geometry.se3 import exp_se3, inverse, log_se3
from rearticulate.observe.frames import Frames
from rearticulate.records import (
    Array,
    FitResult,
    GroundTruth,
    JointDiagnostics,
    JointType,
    KinematicModel,
    Motion,
    PointSequence,
)


def read_pair(path: Path) -> tuple[PointSequence, GroundTruth]:
    """Sequence and truth of NAME.npz, without the checks of the loaders."""
    with np.load(path.with_name(f"{path.stem}.truth.npz")) as data:
        joints = {k: data[k] for k in ("joint_axis", "joint_point", "joint_state") if k in data}
        if "joint_type" in data:
            joints["joint_type"] = tuple(str(kind) for kind in data["joint_type"])
        truth = GroundTruth(tuple(data["labels"]), data["poses"], data["parents"], data["novel"], **joints)
    with np.load(path) as data:
        return PointSequence.from_arrays(data["points"]), truth


def in_spacings(frames: Frames, poses: Array, canonical: int = 0) -> Array:
    """Motions (F, P, 4, 4) from the canonical frame, of poses in metres, in the centred units of `frames`."""
    shift = np.eye(4)
    shift[:3, 3] = frames.centre
    T = inverse(shift) @ poses @ inverse(poses[canonical]) @ shift
    T[..., :3, 3] /= frames.unit
    return T


def perfect_fit(sequence: PointSequence, truth: GroundTruth, canonical: int = 0) -> FitResult:
    """The fit that makes no error: joints from the true relative motions, labels from the truth."""
    poses = truth.poses @ inverse(truth.poses[canonical])
    P = len(truth.parent)
    joints = [("floating", np.zeros(3), np.zeros(3), np.zeros(len(poses)))]
    joints += [_joint(inverse(poses[:, truth.parent[j]]) @ poses[:, j]) for j in range(1, P)]
    kinds, axis, origin, q = zip(*joints, strict=True)
    values = np.stack(q, axis=1)
    labels = tuple(truth.labels[f][sequence.index[f]] for f in range(len(sequence)))
    model = KinematicModel(
        canonical=canonical,
        parent=truth.parent,
        joint_type=kinds,
        axis=np.stack(axis),
        origin=np.stack(origin),
        limits=np.stack([values.min(axis=0), values.max(axis=0)], axis=1),
        names=tuple(f"part_{j}" for j in range(P)),
        points=sequence.points[canonical],
        labels=labels[canonical],
    )
    return FitResult(
        model=model,
        motion=Motion(values, poses[:, 0]),
        labels=labels,
        joints=tuple(JointDiagnostics(0.0, float(np.ptp(v)), 0.0, 0.0, "fixed", np.inf, True) for v in values.T),
        energy=0.0,
        energies={canonical: 0.0},
        residual=np.zeros(len(sequence)),
    )


def _joint(relative: Array) -> tuple[JointType, Array, Array, Array]:
    """Type, axis, origin and values of a one-degree-of-freedom joint from exact relative motions (F, 4, 4)."""
    twist = log_se3(relative)
    largest = twist[np.abs(twist).max(axis=1).argmax()]
    turning = np.linalg.norm(largest[:3]) > 1e-5
    direction = largest[:3] if turning else largest[3:]
    axis = direction / max(float(np.linalg.norm(direction)), 1e-300)
    if not turning:
        return "prismatic", axis, np.zeros(3), twist[:, 3:] @ axis
    origin = np.cross(axis, largest[3:]) / np.linalg.norm(largest[:3])
    return "revolute", axis, origin, twist[:, :3] @ axis


def random_model(seed: int, max_parts: int = 7, points: int = 40) -> KinematicModel:
    """A random tree of revolute and prismatic joints with a small ball of points a part, limits of one unit."""
    rng = np.random.default_rng(seed)
    P = int(rng.integers(1, max_parts + 1))
    kinds: list[JointType] = [
        "floating",
        *(["revolute", "revolute", "prismatic"][i] for i in rng.integers(0, 3, P - 1)),
    ]
    axis = rng.normal(size=(P, 3))
    axis[0] = 0
    axis[1:] /= np.linalg.norm(axis[1:], axis=1, keepdims=True)
    centre = rng.normal(size=(P, 3))
    return KinematicModel(
        canonical=0,
        parent=np.array([-1] + [int(rng.integers(0, j)) for j in range(1, P)]),
        joint_type=tuple(kinds),
        axis=axis,
        origin=centre + 0.3 * rng.normal(size=(P, 3)),
        limits=np.tile([-0.5, 0.5], (P, 1)),
        names=tuple(f"part_{j}" for j in range(P)),
        points=np.concatenate([c + 0.2 * rng.normal(size=(points, 3)) for c in centre]),
        labels=np.repeat(np.arange(P), points),
    )


def assert_joints_explain_poses(truth: GroundTruth) -> None:
    """The true screws and joint values give the true motion of every part against its parent."""
    for j in range(1, len(truth.parent)):
        axis, point = truth.joint_axis[j], truth.joint_point[j]
        turning = truth.joint_type[j] == "revolute"
        twist = np.r_[axis, np.cross(point, axis)] if turning else np.r_[0, 0, 0, axis]
        q = truth.joint_state[:, j] - truth.joint_state[0, j]
        relative = inverse(truth.poses[:, truth.parent[j]]) @ truth.poses[:, j]
        np.testing.assert_allclose(relative, exp_se3(q[:, None] * twist), atol=1e-9)
