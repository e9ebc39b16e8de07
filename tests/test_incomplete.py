"""Frames that show half of the object: found by their size, and fitted by what they do show."""

from __future__ import annotations

import numpy as np
import pytest

from rearticulate.geometry.se3 import exp_se3, log_so3
from rearticulate.observe.frames import make_frames
from rearticulate.pipeline import fit
from rearticulate.records import PointSequence
from rearticulate.search.incomplete import between, complete_frames
from rearticulate.synth import objects
from rearticulate.synth.articulated import record
from test_articulated import tree


def test_small_frames_are_found():
    np.testing.assert_array_equal(complete_frames(np.array([100, 90, 40, 110, 100])), [0, 1, 3, 4])
    np.testing.assert_array_equal(complete_frames(np.array([100, 20, 100])), [0, 1, 2])  # two do not make a sequence


def test_values_between_frames_are_linear_and_constant_beyond():
    model = tree(1)  # four frames
    xi = np.array([0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    model.T_root[:] = exp_se3(np.arange(4)[:, None] * xi)
    model.q[:] = np.arange(4)[:, None] * np.ones(model.n_parts)
    out = between(model, np.array([1, 2, 4, 5]), 7)
    place = np.array([0, 0, 1, 1.5, 2, 3, 3])
    np.testing.assert_allclose(out.q, place[:, None] * np.ones(model.n_parts))
    np.testing.assert_allclose(out.T_root, exp_se3(place[:, None] * xi), atol=1e-9)


def test_some_frames_alone_are_the_same_frames():
    rng = np.random.default_rng(0)
    clouds = [rng.normal(size=(n, 3)) for n in (60, 80, 70)]
    frames = make_frames(clouds)
    some = frames.take(np.array([0, 2]))
    for k, f in enumerate((0, 2)):
        np.testing.assert_array_equal(some.points[some.rows(k)], frames.points[frames.rows(f)])
        np.testing.assert_array_equal(some.order[some.rows(k)], frames.order[frames.rows(f)])
        assert some.trees[k].n == len(clouds[f])


@pytest.mark.parametrize("side", [1, -1])
def test_half_a_frame_does_not_spoil_the_fit(side):
    sequence, truth = record(objects.hinge(), frames=5, points=800, step_deg=12, seed=1)
    clouds, broken = list(sequence.points), 2
    x = clouds[broken]
    clouds[broken] = x[side * (x[:, 0] - np.median(x[:, 0])) > 0]
    result = fit(PointSequence.from_arrays(clouds), seed=0)
    assert result.model.parent.tolist() == [-1, 0]
    assert [len(labels) for labels in result.labels] == [len(c) for c in clouds]
    A = np.linalg.inv(truth.poses[:, 0]) @ truth.poses[:, 1]
    turned = np.linalg.norm(log_so3(A[:, :3, :3] @ A[result.model.canonical, :3, :3].T), axis=1)
    np.testing.assert_allclose(np.abs(result.motion.q[:, 1]), turned, atol=np.deg2rad(2))
