"""Starts for the tracking from correspondences: exact in spite of outliers, and right where steps are large."""

from __future__ import annotations

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.config import FitConfig
from rearticulate.geometry.kabsch import robust_kabsch
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.observe.frames import make_frames
from rearticulate.parts import patches
from rearticulate.parts.matched_starts import MatchedStarts
from rearticulate.parts.patches import make_patches, track_patches
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import arm


def test_motions_of_groups_are_found_among_outliers():
    rng = np.random.default_rng(0)
    group = np.repeat(np.arange(5), 40)
    x = 5 * rng.normal(size=(200, 3)) + 30 * group[:, None]
    T = exp_se3(rng.normal(size=(5, 6)) * np.r_[np.full(3, 0.4), np.full(3, 4.0)])
    y = transform(T[group], x)
    wrong = rng.random(200) < 0.2
    y[wrong] += 40 * rng.normal(size=(wrong.sum(), 3))
    found = robust_kabsch(x, y, group, 5, outlier=6.0)
    np.testing.assert_allclose(found[:, 3], np.broadcast_to([0, 0, 0, 1], (5, 4)))
    np.testing.assert_allclose(np.linalg.det(found[:, :3, :3]), 1)
    error = np.linalg.norm(transform(found[group], x) - transform(T[group], x), axis=1)
    assert error.max() < 1.0


def test_matched_poses_follow_a_large_step():
    """An arm whose joints turn by 25 degrees: nearer to the truth than where it was."""
    sequence, truth = record(arm(), frames=2, points=2000, step_deg=25, start="middle", seed=4)
    frames = make_frames(sequence.points)
    rows = frames.rows(0)
    own = make_patches(frames.points[rows], frames.normals[rows])
    motion = in_spacings(frames, truth.poses, 0)[1]
    labels = truth.labels[0][frames.order[rows]]
    target = transform(motion[labels], own.points)
    matched = MatchedStarts(frames)
    assert matched.possible(0, 1)
    still = np.tile(np.eye(4), (own.count, 1, 1))
    T = matched.poses(still, own.points[own.member], own.patch, 0, 1)
    error = np.linalg.norm(transform(T[own.owner], own.points) - target, axis=1)
    before = np.linalg.norm(own.points - target, axis=1)
    assert np.quantile(error, 0.9) < 0.5 * np.quantile(before, 0.9)
    np.testing.assert_allclose(T @ inverse(T), np.broadcast_to(np.eye(4), T.shape), atol=1e-9)


def test_another_start_must_fit_better_by_a_margin(monkeypatch):
    """Frames too far apart for tracking from rest: another start fits better, but not by any margin."""
    sequence, _ = record(arm(), frames=3, points=2000, step_deg=50, start="middle", seed=0)
    frames = make_frames(sequence.points)

    def tracked(**constants):
        with monkeypatch.context() as patch:
            for name, value in constants.items():
                patch.setattr(patches, name, value)
            return track_patches(frames, 0, FitConfig())

    never = tracked(BAD_COST=1e9, UNUSUAL=1e9)
    unreachable = tracked(BAD_COST=0.0, GAIN=1e9)
    taken = tracked(BAD_COST=0.0)
    np.testing.assert_array_equal(unreachable.T, never.T)
    assert np.abs(taken.T - never.T).max() > 1.0


def test_sparse_frames_are_not_asked():
    clouds = [np.random.default_rng(f).normal(size=(150 + 100 * f, 3)) for f in range(2)]
    matched = MatchedStarts(make_frames(clouds))
    assert matched.possible(1)
    assert not matched.possible(0, 1)


@pytest.mark.parametrize("seed", range(2))
def test_flow_leads_from_points_of_one_frame_to_points_of_the_other(seed):
    sequence, _ = record(arm(), frames=2, points=600, seed=seed)
    frames = make_frames(sequence.points)
    flow = MatchedStarts(frames).flow(0, 1)
    b = frames.points[frames.rows(1)]
    end = flow.anchors + flow.vectors
    assert np.abs(end[:, None] - b[None]).sum(axis=-1).min(axis=1).max() < 1e-9
    assert len(np.unique(end.round(9), axis=0)) == len(end)
