"""How well each joint is known: covariance from the normal equations of the bundle adjustment, and the other type."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.config import ProjectConfig
from rearticulate.geometry.se3 import hat
from rearticulate.records import JointDiagnostics
from rearticulate.solver.articulated import Articulated, reduced_system
from rearticulate.solver.frames import Frames
from rearticulate.solver.joint_repair import subtree
from rearticulate.solver.project import Evidence, contact_point, fit_joints, gather_evidence
from rearticulate.solver.relaxed import Fused, Relaxed, register_to_fused

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

MIN_TURN = 3.0  # a range below this many standard deviations of q is within the noise
MIN_VISIBLE = 0.01  # share of the motion across the surface below which a joint cannot be seen
MAX_AXIS_STD = np.deg2rad(15.0)
NO_JOINT = JointDiagnostics(None, 0.0, None, None, "", None, True)  # of the root


def joint_origins(tree: Articulated, evidence: Evidence) -> Array:
    """(P, 3) for every joint the point of its axis nearest to where its two parts meet."""
    out = np.zeros((tree.n_parts, 3))
    for j in range(1, tree.n_parts):
        axis, foot = tree.axes[j], tree.feet[j]
        near = _meeting_point(evidence, j, int(tree.parent[j]))
        out[j] = foot + axis * (axis @ (near - foot)) if tree.revolute[j] else near
    return out


def _meeting_point(evidence: Evidence, j: int, parent: int) -> Array:
    labels = evidence.fused.labels
    have = [(labels == p).any() for p in (j, parent)]
    if all(have):
        return contact_point(evidence, j, parent)
    if any(have):
        return evidence.fused.z[labels == (j if have[0] else parent)].mean(axis=0)
    return evidence.fused.z.mean(axis=0)


def parameter_deviation(tree: Articulated, evidence: Evidence, origins: Array) -> tuple[Array, Array, Array]:
    """Standard deviations (P,) of axis direction (rad) and axis position (spacings), and (F, P) of the joint values."""
    F, P = tree.q.shape
    A, _, moving = reduced_system(tree, evidence.canonical, evidence.H, np.zeros((F, P, 6)))
    own = P - 1 + 6
    scale = np.sqrt(np.maximum(np.diag(A), 1e-9))
    covariance = evidence.sigma**2 * np.linalg.pinv(A / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    covariance /= np.outer(scale, scale)
    axis_std, origin_std, q_std = np.zeros(P), np.zeros(P), np.zeros((F, P))
    for k, f in enumerate(moving):
        q_std[f, 1:] = np.sqrt(np.maximum(np.diag(covariance)[k * own : k * own + P - 1], 0))
    for j in range(1, P):
        rows = slice(len(moving) * own + 6 * (j - 1), len(moving) * own + 6 * j)
        C = covariance[rows, rows]
        axis = tree.axes[j]
        turn = -hat(axis)
        axis_std[j] = np.sqrt(max(np.trace(turn @ C[:3, :3] @ turn.T), 0))
        across = np.eye(3) - np.outer(axis, axis)
        shift = across @ np.concatenate([-hat(origins[j]), np.eye(3)], axis=1)
        origin_std[j] = np.sqrt(max(np.trace(shift @ C @ shift.T), 0)) if tree.revolute[j] else 0.0
    return axis_std, origin_std, q_std


def diagnose(
    frames: Frames, canonical: int, tree: Articulated, labels: IntArray, config: ProjectConfig
) -> tuple[list[JointDiagnostics], Array]:
    """One record a part, lengths in metres, and the joint origins (P, 3) in spacings.

    The residual compares the joint with the motions the two parts have when they are registered freely.
    """
    free = register_to_fused(frames, canonical, Relaxed(tree.forward(), labels))
    evidence = gather_evidence(frames, canonical, free, config)
    origins = joint_origins(tree, evidence)
    P = tree.n_parts
    if P == 1:
        return [NO_JOINT], origins
    axis_std, origin_std, q_std = parameter_deviation(tree, evidence, origins)
    counts = np.bincount(labels, minlength=P)
    out = [NO_JOINT]
    for j in range(1, P):
        parent = int(tree.parent[j])
        residual, margin = _support(evidence, j, parent, config) if counts[j] and counts[parent] else (None, None)
        seen = visibility(tree, evidence.fused, j)
        out.append(_record(frames.unit, tree, j, counts, residual, margin, seen, axis_std, origin_std, q_std))
    return out, origins


def visibility(tree: Articulated, fused: Fused, j: int) -> float:
    """Share of the motion of joint j that moves points out of their surface, on the side that shows less of it.

    0 for a body of revolution that turns about its own axis and for a wall that slides in its own plane.
    """
    axis, foot = tree.axes[j], tree.feet[j]
    surface = fused.z[fused.surface]
    beyond = np.isin(fused.labels[fused.surface], subtree(tree.parent, j))
    shares = []
    for side in (beyond, ~beyond):
        z, n = surface[side], fused.normals[side]
        motion = np.cross(axis, z - foot) if tree.revolute[j] else np.broadcast_to(axis, z.shape)
        if len(z):
            shares.append((np.einsum("ij,ij->i", n, motion) ** 2).mean() / (motion**2).sum(axis=1).mean())
    return float(min(shares, default=0.0))


def _support(evidence: Evidence, j: int, parent: int, config: ProjectConfig) -> tuple[float, float]:
    """Misfit (spacings, rms) of the best single joint to the relative motion, and what the other type costs more."""
    pair = fit_joints(evidence, np.array([j]), np.array([parent]), config)
    return float(evidence.rms(pair.cost, pair.W)[0]), float((pair.other_cost - pair.cost)[0] / evidence.sigma**2)


def _record(unit, tree, j, counts, residual, margin, seen, axis_std, origin_std, q_std) -> JointDiagnostics:
    span = float(np.ptp(tree.q[:, j]))
    turning = bool(tree.revolute[j])
    typical = float(np.median(q_std[:, j][q_std[:, j] > 0])) if (q_std[:, j] > 0).any() else 0.0
    notes = []
    if counts[j] == 0:
        notes.append("no points of its own: a link inferred from the motion of its neighbours")
    if span < MIN_TURN * typical:
        notes.append("its motion is within the noise")
    if seen < MIN_VISIBLE:
        notes.append("its motion leaves the surface where it is")
    if axis_std[j] > MAX_AXIS_STD:
        notes.append("the axis direction is not fixed by the data")
    return JointDiagnostics(
        residual=None if residual is None else residual * unit,
        observed_range=span if turning else span * unit,
        axis_std=float(axis_std[j]),
        origin_std=float(origin_std[j]) * unit if turning else None,
        runner_up="prismatic" if turning else "revolute",
        runner_up_margin=margin,
        determined=not notes[1 if counts[j] == 0 else 0 :],
        note="; ".join(notes),
    )
