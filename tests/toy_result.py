"""A small sequence, the fit one would hope for, and its ground truth: a base, a hinged arm, a sliding tip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rearticulate.geometry.se3 import transform
from rearticulate.records import (
    FitResult,
    GroundTruth,
    JointDiagnostics,
    KinematicModel,
    Motion,
    PointSequence,
    StageTime,
)

FRAMES = 4


def toy(points: int = 120, names: tuple[str, ...] = ("base", "arm", "tip")) -> tuple[FitResult, PointSequence]:
    """Three boxes in a row along x."""
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(3), points)
    cloud = rng.uniform(-0.5, 0.5, (len(labels), 3)) * [0.2, 0.08, 0.08] + np.array([0.25, 0, 0]) * labels[:, None]
    q = np.zeros((FRAMES, 3))
    q[:, 1] = 0.2 * (np.arange(FRAMES) - 1)
    q[:, 2] = 0.03 * (np.arange(FRAMES) - 1)
    model = KinematicModel(
        canonical=1,
        parent=np.array([-1, 0, 1]),
        joint_type=("floating", "revolute", "prismatic"),
        axis=np.array([[0, 0, 0], [0, 0, 1.0], [1.0, 0, 0]]),
        origin=np.array([[0, 0, 0], [0.125, 0, 0], [0.375, 0, 0]]),
        limits=np.stack([q.min(axis=0), q.max(axis=0)], axis=1),
        names=names,
        points=cloud,
        labels=labels,
    )
    motion = Motion(q, np.broadcast_to(np.eye(4), (FRAMES, 4, 4)).copy())
    sure = JointDiagnostics(0.0004, 0.6, 0.002, 0.0003, "prismatic", 1234.5, True)
    lost = JointDiagnostics(0.0004, 0.09, float("inf"), None, "revolute", None, False, "moves within the noise")
    result = FitResult(
        model=model,
        motion=motion,
        labels=(labels,) * FRAMES,
        joints=(sure, sure, lost),
        energy=0.4,
        energies={0: 0.45, 1: 0.4},
        residual=np.full(FRAMES, 0.0006),
        stages=(StageTime("track", 1.5), StageTime("articulate", 2.0)),
        config={"capture_range": 37.0},
    )
    frames = transform(model.forward(q)[:, labels], cloud)
    return result, PointSequence.from_arrays(frames)


def branched(points: int = 120) -> tuple[FitResult, PointSequence]:
    """A base with two arms, one forearm each, numbered in rings about the base: not depth first."""
    base, _ = toy()
    rng = np.random.default_rng(1)
    centre = np.array([[0, 0, 0], [0.3, 0, 0], [-0.3, 0, 0], [0.6, 0, 0], [-0.6, 0, 0]])
    labels = np.repeat(np.arange(5), points)
    cloud = rng.uniform(-0.5, 0.5, (len(labels), 3)) * [0.25, 0.08, 0.08] + centre[labels]
    q = np.zeros((FRAMES, 5))
    q[:, 1:] = rng.uniform(-0.5, 0.5, (FRAMES, 4))
    q[0] = 0.0
    model = KinematicModel(
        canonical=0,
        parent=np.array([-1, 0, 0, 1, 2]),
        joint_type=("floating", *["revolute"] * 4),
        axis=np.array([[0, 0, 0], *[[0, 0, 1.0]] * 4]),
        origin=np.array([[0, 0, 0], [0.15, 0, 0], [-0.15, 0, 0], [0.45, 0, 0], [-0.45, 0, 0]]),
        limits=np.stack([q.min(axis=0), q.max(axis=0)], axis=1),
        names=("base", "left", "right", "left_hand", "right_hand"),
        points=cloud,
        labels=labels,
    )
    motion = Motion(q, np.broadcast_to(np.eye(4), (FRAMES, 4, 4)).copy())
    joints = (base.joints[0],) * 5
    result = replace(base, model=model, motion=motion, labels=(labels,) * FRAMES, joints=joints, energies={0: 0.4})
    return result, PointSequence.from_arrays(transform(model.forward(q)[:, labels], cloud))


def toy_truth() -> GroundTruth:
    """What `toy` would be scored against."""
    model = toy()[0].model
    motion = toy()[0].motion
    poses = model.forward(motion.q)
    return GroundTruth(
        labels=(model.labels,) * FRAMES,
        poses=poses @ np.linalg.inv(poses[:1]),
        parent=model.parent,
        novel=poses[-1:] @ np.linalg.inv(poses[:1]),
    )
