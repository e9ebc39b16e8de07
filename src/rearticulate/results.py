"""From the fitter's units and its working points back to metres and to every point of the input."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from rearticulate.arrays import Array, Float, Int
from rearticulate.config import FitConfig
from rearticulate.geometry.se3 import from_unit
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.diagnose import diagnose
from rearticulate.machine import machine
from rearticulate.methods.problem import Candidate
from rearticulate.methods.spherical import BallTree, diagnose_balls
from rearticulate.observe.frames import Frames
from rearticulate.observe.misfit import frame_residual, sampling_distance
from rearticulate.observe.scale import Scales, frame_scales
from rearticulate.parts.relaxed import Relaxed
from rearticulate.records import (
    FitResult,
    JointDiagnostics,
    JointType,
    KinematicModel,
    Motion,
    PointSequence,
    RelaxedModel,
)


def to_result(
    sequence: PointSequence,
    chosen: list[Int[Array, " _"]],
    frames: Frames,
    best: Candidate,
    config: FitConfig,
    seed: int,
    energies: dict[int, float],
) -> FitResult:
    """Back to metres and to the input's points."""
    tree, c, T = best.tree, best.canonical, best.tree.forward()
    scales = frame_scales(frames, c, T, best.labels)
    stopped = too_many_parts(best.relaxed, config)
    if isinstance(tree, Articulated):
        joints = screw_joints(frames, best, config, scales.drift)
    else:
        joints = ball_joints(frames, best, tree)
    labels = all_labels(sequence, chosen, frames, best.labels)
    model = KinematicModel(
        canonical=c,
        parent=tree.parent,
        joint_type=joints.kinds,
        axis=joints.axis,
        origin=joints.origin,
        limits=joints.limits,
        names=tuple(f"part_{j}" for j in range(tree.n_parts)),
        points=sequence.points[c],
        labels=labels[c],
    )
    return FitResult(
        model=model,
        motion=Motion(joints.q, from_unit(tree.T_root, frames.unit, frames.centre)),
        labels=labels,
        joints=tuple(withdrawn(joints.diagnostics) if stopped else joints.diagnostics),
        energy=best.energy,
        energies=energies,
        residual=frame_residual(frames, c, T, best.labels) * frames.unit,
        config=asdict(config),
        seed=seed,
        relaxed=relaxed_model(sequence, chosen, frames, best),
        notes=(*stopped, *few_states(frames.n_frames), *(() if stopped else other_scales(scales, c))),
        machine=machine(),
        sampling=sampling_distance(frames) * frames.unit,
    )


@dataclass(frozen=True)
class Joints:
    """The joints of a result, as in `KinematicModel` and `Motion`."""

    kinds: tuple[JointType, ...]
    axis: Float[Array, "P 3"]
    origin: Float[Array, "P 3"]
    limits: Float[Array, "P 2"]
    q: Float[Array, "F D"]
    diagnostics: list[JointDiagnostics]


def screw_joints(frames: Frames, best: Candidate, config: FitConfig, drift: float) -> Joints:
    """Hinges and slides. drift: of the scale, see `Scales`."""
    tree = best.tree
    assert isinstance(tree, Articulated)
    diagnostics, origins = diagnose(frames, best.canonical, tree, best.labels, config.slide_margin, drift)
    kinds: list[JointType] = ["revolute" if turning else "prismatic" for turning in tree.revolute]
    kinds[0] = "floating"
    q = np.where(tree.revolute, tree.q, tree.q * frames.unit)
    q[:, 0] = 0.0
    origin = np.where(np.arange(tree.n_parts)[:, None] == 0, 0.0, origins * frames.unit + frames.centre)
    return Joints(tuple(kinds), tree.axes, origin, np.stack([q.min(axis=0), q.max(axis=0)], axis=1), q, diagnostics)


def ball_joints(frames: Frames, best: Candidate, tree: BallTree) -> Joints:
    """Ball joints: the second and third number of each rotation vector come after the first ones of all parts."""
    P = tree.n_parts
    kinds: list[JointType] = ["floating", *["spherical"] * (P - 1)]  # type: ignore[list-item]
    origin = tree.centre * frames.unit + frames.centre
    origin[0] = 0.0
    q = np.concatenate([tree.turn[:, :, 0], tree.turn[:, 1:, 1:].reshape(len(tree.turn), -1)], axis=1)
    angle = np.linalg.norm(tree.turn, axis=-1).max(axis=0)
    limits = np.stack([np.zeros(P), angle], axis=1)
    diagnostics = diagnose_balls(frames, best.canonical, tree, best.labels)
    return Joints(tuple(kinds), np.zeros((P, 3)), origin, limits, q, diagnostics)


def too_many_parts(relaxed: Relaxed, config: FitConfig) -> tuple[str, ...]:
    """What a fit cannot tell that ended at its limit, not where the points are explained."""
    if relaxed.found <= config.max_parts:
        return ()
    return (
        f"stopped at {config.max_parts} of {relaxed.found} rigid parts: this does not look like one object of jointed "
        "rigid parts (does something bend or flow, are the frames of one object, is their order right?); do not trust "
        "its joints",
    )


def withdrawn(joints: list[JointDiagnostics]) -> list[JointDiagnostics]:
    """The joints, none but the root called determined."""
    why = "the search for parts stopped before the points were explained"
    return [joints[0], *(replace(j, determined=False, note="; ".join(filter(None, (j.note, why)))) for j in joints[1:])]


def few_states(frames: int) -> tuple[str, ...]:
    """What two frames cannot tell."""
    if frames > 2:
        return ()
    return ("two states support few claims: between two, any small motion is a joint; a third one would confirm it",)


def other_scales(scales: Scales, canonical: int) -> tuple[str, ...]:
    """Which frames are of another size than the canonical one."""
    frames = np.flatnonzero(scales.differ)
    if not len(frames):
        return ()
    sizes = ", ".join(f"{scales.size[f]:.3f}" for f in frames)
    which = f"frame {frames[0]} is" if len(frames) == 1 else f"frames {', '.join(map(str, frames))} are"
    return (
        f"{which} {sizes} times as large as frame {canonical}: was each scaled by itself? Parts that seem to move by "
        "less than that explains do not make a joint",
    )


def relaxed_model(
    sequence: PointSequence, chosen: list[Int[Array, " _"]], frames: Frames, best: Candidate
) -> RelaxedModel | None:
    """The parts before they were joined; None where incomplete frames took no part."""
    if len(best.relaxed.T) != frames.n_frames:
        return None
    labels = all_labels(sequence, chosen, frames, best.relaxed.labels)[best.canonical]
    return RelaxedModel(sequence.points[best.canonical], labels, from_unit(best.relaxed.T, frames.unit, frames.centre))


def all_labels(
    sequence: PointSequence, chosen: list[Int[Array, " _"]], frames: Frames, labels: Int[Array, " M"]
) -> tuple[Int[Array, " _"], ...]:
    """Labels of every input point; a point that took no part in the fit asks its nearest neighbours of its frame."""
    flat = np.empty_like(labels)
    flat[frames.order] = labels
    out = []
    for f, points in enumerate(sequence.points):
        fitted = flat[frames.start[f] : frames.start[f + 1]]
        label = np.empty(len(points), dtype=np.int64)
        label[chosen[f]] = fitted
        rest = np.setdiff1d(np.arange(len(points)), chosen[f])
        if len(rest):
            label[rest] = fitted[KDTree(points[chosen[f]]).query(points[rest], workers=-1)[1]]
        out.append(label)
    return tuple(out)
