"""New scans of a known object: frames that were held out, postures never recorded, links without evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from oracle import perfect_fit
from rearticulate.errors import InputError
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.io import load_sequence, load_truth
from rearticulate.localization.localize import track
from rearticulate.records import FitResult, Motion, PointSequence
from rearticulate.synth import bundled

C = 5


def without(result: FitResult, sequence: PointSequence, frames: list[int]) -> tuple[FitResult, PointSequence]:
    """The same, as if these frames had not been recorded."""
    kept = [f for f in range(len(sequence)) if f not in frames]
    motion = Motion(result.motion.q[kept], result.motion.T_world_root[kept])
    model = replace(result.model, canonical=kept.index(C))
    labels = tuple(result.labels[f] for f in kept)
    fewer = replace(result, model=model, motion=motion, labels=labels, residual=result.residual[kept])
    return fewer, PointSequence.from_arrays([sequence.points[f] for f in kept])


@pytest.fixture(scope="module")
def arm() -> tuple[FitResult, PointSequence]:
    sequence = load_sequence(bundled.path("so101"))
    return perfect_fit(sequence, load_truth(bundled.truth_path("so101")), C), sequence


def mean_error(result: FitResult, T_found: np.ndarray, T_true: np.ndarray) -> float:
    """Mean distance of the points of the model between two sets of part poses (P, 4, 4), of the object's size."""
    model = result.model
    size = np.linalg.norm(np.ptp(model.points, axis=0))
    gap = transform(T_found[model.labels], model.points) - transform(T_true[model.labels], model.points)
    return float(np.linalg.norm(gap, axis=1).mean() / size)


def test_frames_that_were_held_out_are_found(arm: tuple[FitResult, PointSequence]) -> None:
    result, sequence = arm
    held = [8, 9]
    fewer, recorded = without(result, sequence, held)
    found = track(fewer, recorded, PointSequence.from_arrays([sequence.points[f] for f in held]))
    T_found = result.model.forward(found.motion.q, found.motion.T_world_root)
    T_true = result.model.forward(result.motion.q[held], result.motion.T_world_root[held])
    for k, f in enumerate(held):
        assert mean_error(result, T_found[k], T_true[k]) < 0.01
        assert (found.labels[k] == result.labels[f]).mean() > 0.9


@pytest.mark.parametrize("elsewhere", [False, True], ids=["a new posture", "a known posture elsewhere"])
def test_what_was_never_recorded_is_found(arm: tuple[FitResult, PointSequence], elsewhere: bool) -> None:
    result, sequence = arm
    model = result.model
    q = result.motion.q[3] if elsewhere else np.random.default_rng(2).uniform(*model.limits.T)
    root = exp_se3(np.array([0.1, -0.05, 0.2, 0.05, 0.02, -0.04])) if elsewhere else np.eye(4)
    T_seen = model.forward(result.motion.q[2], result.motion.T_world_root[2])
    T_new = model.forward(q, root)
    cloud = transform((T_new @ np.linalg.inv(T_seen))[result.labels[2]], sequence.points[2])
    fewer, recorded = without(result, sequence, [2])
    found = track(fewer, recorded, PointSequence.from_arrays([cloud]))
    T_found = model.forward(found.motion.q, found.motion.T_world_root)[0]
    assert mean_error(result, T_found, T_new) < 0.01


def test_too_few_points_are_refused(arm: tuple[FitResult, PointSequence]) -> None:
    with pytest.raises(InputError, match="frame 0: 20 points are too few"):
        track(*arm, PointSequence.from_arrays([arm[1].points[0][:20]]))
