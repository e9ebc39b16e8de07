"""How well a fit explains what partial views show: points of a part that a frame hides cannot be known there."""

from __future__ import annotations

import numpy as np

from rearticulate.evaluation.metrics import point_motion
from rearticulate.records import FitResult, GroundTruth, PointSequence

ENOUGH = 10  # points of a part that a frame must show


def seen_metrics(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> dict[str, float]:
    """seen_share: of all canonical points in all frames, those whose true part shows `ENOUGH` points in both frames.
    seen_recon_cm: the reconstruction error over them alone."""
    c, P = result.model.canonical, len(truth.parent)
    true_labels = [truth.labels[f][index] for f, index in enumerate(sequence.index)]
    shown = np.stack([np.bincount(labels, minlength=P) for labels in true_labels]) >= ENOUGH
    labels = true_labels[c]
    seen = (shown & shown[c])[:, labels]
    predicted, true = point_motion(result, truth, labels)
    error = np.linalg.norm(predicted - true, axis=-1)
    return {"seen_share": float(seen.mean()), "seen_recon_cm": 100 * float(error[seen].mean())}
