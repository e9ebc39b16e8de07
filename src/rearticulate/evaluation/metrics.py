"""The paper's metrics and errors of the joints (CVPR 2023, supplement, "Evaluation Metrics"), robots in centimetres.

Every estimate is scored on the fitted points of the canonical frame; the truth moves the same points.
"""

from __future__ import annotations

import numpy as np

from rearticulate.errors import InputError
from rearticulate.evaluation.clustering import rand_index
from rearticulate.evaluation.joints import axis_z_scores, existing_joints, joint_errors, match_parts
from rearticulate.evaluation.structure import structure_metrics
from rearticulate.evaluation.tree_distance import tree_edit_distance
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.records import Array, FitResult, GroundTruth, IntArray, Metric, PointSequence
from rearticulate.retargeting.retarget import retarget

CLICK = 10  # reanimation clicks this point of every true part, in file order, so that all methods get the same clicks


def evaluate(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> list[Metric]:
    """All metrics of a fit. sequence: what was fitted; its `index` leads from fitted points to the truth's labels."""
    _check(result, truth, sequence)
    true_labels = [truth.labels[f][sequence.index[f]] for f in range(len(sequence))]
    labels = canonical_labels(result, truth, sequence)
    match = match_parts(result, truth, true_labels)
    return [
        *flow_metrics(*point_motion(result, truth, labels)),
        *_segmentation_metrics(result, true_labels),
        Metric("tree_edit_distance", tree_edit_distance(result.model.parent, truth.parent), "edits", "lower"),
        *structure_metrics(result, truth, match),
        *_reanimation_metrics(result, truth, labels, sequence.index[result.model.canonical]),
        Metric("parts", result.model.n_parts, "parts", ""),
        Metric("parts_true", len(truth.parent), "parts", ""),
        *_joint_metrics(result, truth, true_labels, match),
    ]


def canonical_labels(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> IntArray:
    """(N,) true part of every point of the canonical cloud."""
    c = result.model.canonical
    return truth.labels[c][sequence.index[c]]


def _check(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> None:
    F, c = len(sequence), result.model.canonical
    if not len(truth.poses) == len(truth.labels) == len(result.motion.q) == F:
        raise InputError(
            f"the sequence has {F} frames, the result {len(result.motion.q)} and the ground truth {len(truth.poses)}: "
            "all three must belong to the same sequence"
        )
    for f, index in enumerate(sequence.index):
        if len(index) and index.max() >= len(truth.labels[f]):
            raise InputError(
                f"{sequence.names[f]} has a point number {index.max()} but the ground truth labels only "
                f"{len(truth.labels[f])} points: give the ground truth of this sequence"
            )
    if len(result.model.points) != len(sequence.points[c]):
        raise InputError(
            f"the model has {len(result.model.points)} points and {sequence.names[c]}, its canonical frame, "
            f"has {len(sequence.points[c])}: give the sequence that was fitted"
        )


def point_motion(result: FitResult, truth: GroundTruth, labels: IntArray) -> tuple[Array, Array]:
    """(F, N, 3) where the fit and the truth carry the canonical points, of true parts labels (N,)."""
    model, motion = result.model, result.motion
    predicted = transform(model.forward(motion.q, motion.T_world_root)[:, model.labels], model.points)
    return predicted, transform(truth.motion(model.canonical)[:, labels], model.points)


def flow_metrics(predicted: Array, true: Array) -> list[Metric]:
    """Reconstruction error of points (F, N, 3), and the errors of the flow between consecutive frames."""
    recon = np.linalg.norm(predicted - true, axis=-1).mean()
    flow = np.diff(true, axis=0)
    error = np.linalg.norm(np.diff(predicted, axis=0) - flow, axis=-1)
    length = np.linalg.norm(flow, axis=-1)
    return [
        Metric("recon_cm", 100 * recon, "cm", "lower"),
        Metric("flow_epe_cm", 100 * error.mean() if error.size else 0.0, "cm", "lower"),
        *(
            Metric(f"flow_acc_{name}", flow_accuracy(error, length, d), "share", "higher")
            for name, d in (("5mm", 0.005), ("10mm", 0.01), ("5cm", 0.05), ("10cm", 0.1))
        ),
    ]


def flow_accuracy(error: Array, length: Array, threshold: float) -> float:
    """Share of flow vectors whose error is at most `threshold` metres, or at most that share of the true length."""
    if not error.size:
        return 1.0
    return float(((error <= threshold) | (error <= threshold * length)).mean())


def _segmentation_metrics(result: FitResult, true_labels: list[IntArray]) -> list[Metric]:
    """Rand index in the canonical frame, over the points of all frames together, and frame by frame."""
    model = result.model
    pairs = list(zip(true_labels, result.labels, strict=True))
    values = {
        "rand_index": rand_index(true_labels[model.canonical], model.labels),
        "rand_index_multi_scan": rand_index(np.concatenate(true_labels), np.concatenate(result.labels)),
        "rand_index_per_scan": float(np.mean([rand_index(a, b) for a, b in pairs])),
    }
    return [Metric(key, value, "share", "higher") for key, value in values.items()]


def clicks(labels: IntArray, index: IntArray, n_parts: int) -> IntArray:
    """One canonical point a true part: number CLICK in file order, the last of a smaller part, none of an empty one.

    labels: (N,) true part of each canonical point. index: (N,) its row in the file.
    """
    order = np.argsort(index, kind="stable")
    members = [order[labels[order] == p] for p in range(n_parts)]
    return np.array([m[min(CLICK, len(m) - 1)] for m in members if len(m)], dtype=np.int64)


def _reanimation_metrics(result: FitResult, truth: GroundTruth, labels: IntArray, index: IntArray) -> list[Metric]:
    """Error over all points after solving each novel pose from one correspondence a true part."""
    model = result.model
    if not len(truth.novel):
        return []
    chosen = clicks(labels, index, len(truth.parent))
    errors = []
    for pose in truth.novel @ inverse(truth.poses[model.canonical]):
        target = transform(pose[labels], model.points)
        found = retarget(model, model.points[chosen], target[chosen])
        errors.append(np.linalg.norm(model.pose(found.q, found.T_world_root) - target, axis=-1).mean())
    return [Metric("reanimate_cm", 100 * float(np.mean(errors)), "cm", "lower")]


def _joint_metrics(result: FitResult, truth: GroundTruth, true_labels: list[IntArray], match: IntArray) -> list[Metric]:
    """Type of every true joint (missing ones count as wrong); axes of those whose type is right and that are sure."""
    if truth.joint_type is None or truth.joint_axis is None or truth.joint_point is None or len(truth.parent) < 2:
        return []
    errors = joint_errors(result, truth, match)
    right = [e for e in errors if e.type_right]
    sure = [e for e in right if result.joints[e.predicted].determined]
    real = existing_joints(result, truth, true_labels, errors)
    determined = np.array([joint.determined for joint in result.joints])
    n_true = len(truth.parent) - 1
    metrics = [
        Metric("joint_type_share", len(right) / n_true, "share", "higher"),
        Metric("joints_sure_share", len(sure) / n_true, "share", "higher"),
        Metric("joints_sure_wrong", int((determined & ~real).sum()), "joints", "lower"),
        Metric("joints_real", int(real[1:].sum()), "joints", ""),
        Metric("joints_real_sure", int((determined & real)[1:].sum()), "joints", "higher"),
        Metric("joints_made_up", int((~real).sum()), "joints", "lower"),
    ]
    if sure:
        degrees = float(np.degrees(np.median([e.axis_rad for e in sure])))
        metrics.append(Metric("joint_axis_median_deg", degrees, "deg", "lower"))
    z = axis_z_scores(sure, result)
    if len(z):
        metrics += [
            Metric("axis_z_rms", float(np.sqrt(np.mean(z**2))), "", ""),
            Metric("axis_z_squared_sum", float(np.sum(z**2)), "", ""),  # with the count, to pool several objects
            Metric("axis_z_count", len(z), "joints", ""),
        ]
    offsets = [e.position_m for e in sure if not np.isnan(e.position_m)]
    if offsets:
        size = np.linalg.norm(np.ptp(result.model.points, axis=0))
        metrics.append(Metric("joint_position_median_percent", 100 * float(np.median(offsets) / size), "%", "lower"))
    return metrics
