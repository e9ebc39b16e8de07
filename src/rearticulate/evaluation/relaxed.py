"""The paper's metrics of a relaxed model, whose parts are not joined: the ablation without projection (Table 4)."""

from __future__ import annotations

import numpy as np

from rearticulate.evaluation.clustering import rand_index
from rearticulate.evaluation.metrics import clicks, flow_metrics
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.records import Array, GroundTruth, IntArray, Metric, PointSequence, RelaxedModel


def evaluate_relaxed(model: RelaxedModel, truth: GroundTruth, sequence: PointSequence, canonical: int) -> list[Metric]:
    """Errors of the motion, the segmentation, and reanimation part by part."""
    index = sequence.index[canonical]
    labels = truth.labels[canonical][index]
    predicted = transform(model.T_world_part[:, model.labels], model.points)
    true = transform(truth.motion(canonical)[:, labels], model.points)
    return [
        *flow_metrics(predicted, true),
        Metric("rand_index", rand_index(labels, model.labels), "share", "higher"),
        *_reanimation(model, truth, canonical, labels, index),
        Metric("parts", len(np.unique(model.labels)), "parts", "lower"),
        Metric("parts_true", len(truth.parent), "parts", "lower"),
    ]


def _reanimation(
    model: RelaxedModel, truth: GroundTruth, canonical: int, labels: IntArray, index: IntArray
) -> list[Metric]:
    """Every part is shifted as its clicks are: nothing tells how it turns. A part without any stays."""
    chosen = clicks(labels, index, len(truth.parent))
    errors = []
    for pose in truth.novel @ inverse(truth.poses[canonical]):
        target = transform(pose[labels], model.points)
        moved = model.points + _mean_shift(model.labels, chosen, (target - model.points)[chosen])[model.labels]
        errors.append(np.linalg.norm(moved - target, axis=-1).mean())
    return [Metric("reanimate_cm", 100 * float(np.mean(errors)), "cm", "lower")] if errors else []


def _mean_shift(labels: IntArray, chosen: IntArray, shift: Array) -> Array:
    """(P, 3) mean shift (K, 3) of the chosen points (K,) of every part."""
    P = labels.max() + 1
    total = np.zeros((P, 3))
    np.add.at(total, labels[chosen], shift)
    return total / np.maximum(np.bincount(labels[chosen], minlength=P), 1)[:, None]
