"""How well each joint is known: covariance from the normal equations of the bundle adjustment, and the other type."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.kinematics import subtree
from rearticulate.geometry.se3 import hat
from rearticulate.joints.articulated import Articulated, reduced_system
from rearticulate.joints.chains import fit_prismatic, fit_revolute, relative_motion, rest_cost
from rearticulate.joints.claims import Claim, doubts, is_outside
from rearticulate.joints.evidence import Evidence, contact_point, gather_evidence
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import Fused
from rearticulate.parts.relaxed import Relaxed, register_to_fused
from rearticulate.records import JointDiagnostics

NO_JOINT = JointDiagnostics(None, 0.0, None, None, "", None, True)  # of the root


def joint_origins(tree: Articulated, evidence: Evidence) -> Float[Array, "P 3"]:
    """For every joint the point of its axis nearest to where its two parts meet."""
    out = np.zeros((tree.n_parts, 3))
    for j in range(1, tree.n_parts):
        axis, foot = tree.axes[j], tree.feet[j]
        near = _meeting_point(evidence, j, int(tree.parent[j]))
        out[j] = foot + axis * (axis @ (near - foot)) if tree.revolute[j] else near
    return out


def _meeting_point(evidence: Evidence, j: int, parent: int) -> Float[Array, " 3"]:
    labels = evidence.fused.labels
    have = [(labels == p).any() for p in (j, parent)]
    if all(have):
        return contact_point(evidence, j, parent)
    if any(have):
        return evidence.fused.z[labels == (j if have[0] else parent)].mean(axis=0)
    return evidence.fused.z.mean(axis=0)


def parameter_deviation(
    tree: Articulated, evidence: Evidence, origins: Float[Array, "P 3"]
) -> tuple[Float[Array, " P"], Float[Array, " P"], Float[Array, "F P"]]:
    """Standard deviations of axis direction (rad) and axis position (spacings), and of the joint values."""
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
    frames: Frames,
    canonical: int,
    tree: Articulated,
    labels: Int[Array, " M"],
    slide_margin: float,
    drift: float = 0.0,
) -> tuple[list[JointDiagnostics], Float[Array, "P 3"]]:
    """One record a part, lengths in metres, and the joint origins in spacings. drift: see `Scales`.

    The residual compares the joint with the motions the two parts have when they are registered freely.
    """
    free = register_to_fused(frames, canonical, Relaxed(tree.forward(), labels))
    evidence = gather_evidence(frames, canonical, free)
    origins = joint_origins(tree, evidence)
    if tree.n_parts == 1:
        return [NO_JOINT], origins
    deviations = parameter_deviation(tree, evidence, origins)
    size = float(np.linalg.norm(np.ptp(frames.points[frames.rows(canonical)], axis=0)))
    out = [NO_JOINT]
    for j in range(1, tree.n_parts):
        support = joint_support(evidence, j, int(tree.parent[j]), bool(tree.revolute[j]), size, slide_margin)
        axis_std, origin_std, value_std = (support.inflation * np.asarray(x)[..., j] for x in deviations)
        typical = float(np.median(value_std[value_std > 0])) if (value_std > 0).any() else 0.0
        claim = claim_of(frames, tree, evidence, j, support, float(axis_std), typical, size, drift)
        out.append(_record(frames.unit, claim, support, float(origin_std)))
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


@dataclass(frozen=True)
class Support:
    """What the free motions of two parts say about their joint; lengths in spacings, None where not measured.

    motion, misfit: rms motion of the points as far as it leaves the surface, and what the best joint of the type leaves
    of it. margin: what the other type costs more, chi-square; infinite where a slide's rival is a hinge outside of the
    object, which is no hinge. inflation: of the deviations, where the misfit is larger than they allow for.
    """

    motion: float | None = None
    misfit: float | None = None
    margin: float | None = None
    inflation: float = 1.0


def joint_support(evidence: Evidence, j: int, parent: int, turning: bool, size: float, slide_margin: float) -> Support:
    """The support of joint j of a type; nothing where one of its parts has no points. size: of the object.
    slide_margin: chi-square by which a hinge may fit better than a slide that is preferred."""
    z = evidence.fused.z[evidence.fused.labels == j]
    if not len(z) or not (evidence.fused.labels == parent).any():
        return Support()
    A, W = relative_motion(evidence.T, evidence.H, np.array([j]), np.array([parent]), evidence.canonical)
    turn = fit_revolute(A, W, evidence.canonical)
    slide = fit_prismatic(A, W, z.mean(axis=0)[None], evidence.canonical)
    own, other = (turn, slide) if turning else (slide, turn)
    margin = float((other.cost - own.cost)[0] / evidence.sigma**2)
    if not turning and margin > -slide_margin and is_outside(axis_distance(turn.twist[0, 0], z), size):
        margin = np.inf
    free = max(6 * (len(A[0]) - 1) - len(A[0]) - (3 if turning else 1), 1)
    excess = float(own.cost[0] / evidence.sigma**2 / free)
    return Support(
        motion=float(evidence.rms(rest_cost(A, W), W)[0]),
        misfit=float(evidence.rms(own.cost, W)[0]),
        margin=margin,
        inflation=float(np.sqrt(max(excess, 1.0))),
    )


def axis_distance(twist: Float[Array, " 6"], z: Float[Array, "n 3"]) -> float:
    """Distance of the nearest of points z from the axis of a turn, twist."""
    axis, foot = twist[:3], np.cross(twist[:3], twist[3:])
    return float(np.linalg.norm(np.cross(z - foot, axis), axis=1).min())


def claim_of(
    frames: Frames,
    tree: Articulated,
    evidence: Evidence,
    j: int,
    support: Support,
    axis_std: float,
    value_std: float,
    size: float,
    drift: float,
) -> Claim:
    """What joint j may be doubted for. Lengths of the arguments in spacings, of the claim in metres."""
    fused, turning, unit = evidence.fused, bool(tree.revolute[j]), frames.unit
    beyond = fused.z[np.isin(fused.labels, subtree(tree.parent, j))]
    both = fused.z[np.isin(fused.labels, (j, tree.parent[j]))]
    span, foot = float(np.ptp(tree.q[:, j])), tree.feet[j]
    arm = np.linalg.norm(np.cross(beyond - foot, tree.axes[j]), axis=1) if turning else np.ones(len(beyond))
    return Claim(
        frames=frames.n_frames,
        turning=turning,
        points=float((fused.labels == j).sum() / frames.n_frames),
        span=span if turning else span * unit,
        value_std=value_std if turning else value_std * unit,
        axis_std=axis_std,
        path=span * float(np.sqrt((arm**2).mean())) * unit if len(beyond) else np.inf,
        motion=None if support.motion is None else support.motion * unit,
        misfit=None if support.misfit is None else support.misfit * unit,
        away=axis_distance(tree.twist[j], both) * unit if turning and len(both) else 0.0,
        size=size * unit,
        seen=visibility(tree, fused, j),
        drift=drift,
    )


def _record(unit: float, claim: Claim, support: Support, origin_std: float) -> JointDiagnostics:
    against = doubts(claim)
    inferred = [] if claim.points else ["no points of its own: a link inferred from the motion of its neighbours"]
    return JointDiagnostics(
        residual=claim.misfit,
        observed_range=claim.span,
        axis_std=claim.axis_std,
        origin_std=origin_std * unit if claim.turning else None,
        runner_up="prismatic" if claim.turning else "revolute",
        runner_up_margin=support.margin,
        determined=not against,
        note="; ".join(inferred + against),
    )
