"""Estimated joints against true ones: type, axis direction, axis position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from rearticulate.geometry.se3 import rotate, transform
from rearticulate.records import Array, FitResult, GroundTruth, IntArray, KinematicModel

SAME_AXIS = np.deg2rad(10)  # between pieces of two parts


@dataclass(frozen=True)
class JointError:
    """One true joint j that has an estimated counterpart: model joint k.

    type_right; axis_rad: angle between the axes up to sign; position_m: NaN for a slide, which has no position.
    """

    true: int
    predicted: int
    type_right: bool
    axis_rad: float
    position_m: float


def match_parts(result: FitResult, truth: GroundTruth, true_labels: list[IntArray]) -> IntArray:
    """(P_true,) the model part that stands for each true part, one to one; -1 where none.

    Of the parts that share points with it, in any frame, the one that moves most like it: a joint relates motions, and
    a housing that is round about the next axis may carry the label of either part. true_labels: (N_f,) a frame.
    """
    model, motion = result.model, result.motion
    shared = np.zeros((len(truth.parent), model.n_parts), dtype=bool)
    shared[np.concatenate(true_labels), np.concatenate(result.labels)] = True
    predicted = model.forward(motion.q, motion.T_world_root)
    true = truth.motion(model.canonical)
    error = np.empty(shared.shape)
    for p in range(len(shared)):
        x = model.points[true_labels[model.canonical] == p]
        error[p] = motion_error(predicted, true[:, p], x if len(x) else model.points)
    rows, columns = linear_sum_assignment(np.where(shared, error, 1e3 * (1 + error.max())))
    match = np.full(len(shared), -1, dtype=np.int64)
    found = shared[rows, columns]
    match[rows[found]] = columns[found]
    return match


def motion_error(predicted: Array, true: Array, x: Array) -> Array:
    """(P,) root mean square distance, m, between where motions predicted (F, P, 4, 4) and true (F, 4, 4) carry points x
    (N, 3), over all frames."""
    h = np.concatenate([x, np.ones((len(x), 1))], axis=1)
    D = (predicted - true[:, None])[..., :3, :]
    return np.sqrt(np.einsum("fpij,jk,fpik->p", D, h.T @ h / len(h), D) / len(D))


def joint_errors(result: FitResult, truth: GroundTruth, match: IntArray) -> list[JointError]:
    """Errors of all true joints whose two parts are matched to adjacent parts of the model. match: (P_true,), -1 none.

    Needs truth.joint_type, joint_axis and joint_point.
    """
    assert truth.joint_type is not None and truth.joint_axis is not None and truth.joint_point is not None
    model, errors = result.model, []
    for j in np.flatnonzero(truth.parent >= 0):
        k = _joint_between(model, int(match[j]), int(match[truth.parent[j]]))
        if k < 0:
            continue
        # frame 0 to the canonical frame: an axis moves with both of its parts
        T = truth.poses[model.canonical, truth.parent[j]]
        axis, point = rotate(T, truth.joint_axis[j]), transform(T, truth.joint_point[j])
        right = truth.joint_type[j] == model.joint_type[k]
        position = _distance_to_line(model.origin[k], point, axis) if model.joint_type[k] == "revolute" else np.nan
        errors.append(JointError(int(j), k, right, angle_of_lines(model.axis[k], axis), position))
    return errors


def axis_z_scores(errors: list[JointError], result: FitResult) -> Array:
    """(K,) errors of axis directions over the deviations that the fit reports for them, where it reports any.

    An `axis_std` is that of the whole direction, of both its components together: where all are honest, the root mean
    square is 1 (it would be 1.41 for the deviation of one component).
    """
    pairs = [(e.axis_rad, result.joints[e.predicted].axis_std) for e in errors]
    return np.array([error / std for error, std in pairs if std])


def existing_joints(
    result: FitResult, truth: GroundTruth, true_labels: list[IntArray], errors: list[JointError]
) -> NDArray[np.bool_]:
    """(P,) which joints of the model exist: those that stand for a true one of their type (`errors`), and those between
    pieces of two parts that a joint of this type links, about the same axis. A fit may cut one part into pieces, but
    the joints within it are made up. True at the root."""
    assert truth.joint_axis is not None and truth.joint_type is not None
    model = result.model
    labels, true = np.concatenate(result.labels), np.concatenate(true_labels)
    shared = np.zeros((model.n_parts, len(truth.parent)), dtype=np.int64)
    np.add.at(shared, (labels, true), 1)
    most = np.where(shared.any(axis=1), shared.argmax(axis=1), -1)
    out = np.arange(model.n_parts) == 0
    out[[e.predicted for e in errors if e.type_right]] = True
    for k in range(1, model.n_parts):
        a, b = int(most[k]), int(most[model.parent[k]])
        for child, parent in ((a, b), (b, a)):
            if min(a, b) >= 0 and truth.parent[child] == parent:
                axis = rotate(truth.poses[model.canonical, parent], truth.joint_axis[child])
                alike = truth.joint_type[child] == model.joint_type[k]
                out[k] |= alike and angle_of_lines(model.axis[k], axis) < SAME_AXIS
    return out


def _joint_between(model: KinematicModel, a: int, b: int) -> int:
    """The joint that links parts a and b directly, -1 when there is none (or a part is missing)."""
    if a < 0 or b < 0:
        return -1
    if model.parent[a] == b:
        return int(a)
    return int(b) if model.parent[b] == a else -1


def angle_of_lines(a: Array, b: Array) -> float:
    """Angle between two directions (3,) up to sign, rad in [0, pi/2]; pi/2 when one of them is zero (a fixed joint)."""
    if not a.any() or not b.any():
        return np.pi / 2
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b)))


def _distance_to_line(x: Array, point: Array, axis: Array) -> float:
    """Distance of x (3,) from the line through point (3,) along axis (3,).

    With x the point of the estimated axis nearest to its joint, this is the distance of the axes *at the joint*; the
    closest approach of two almost parallel lines may be far from the object and says nothing.
    """
    return float(np.linalg.norm(np.cross(x - point, axis)) / np.linalg.norm(axis))
