"""Rigid fits from moments against a solver of scipy's, and the agglomeration of patches."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rearticulate.config import FitConfig
from rearticulate.evaluation.clustering import rand_index
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.parts import patches
from rearticulate.parts.cluster import adjacent_labels, cluster, moments


def scattered(seed=0, noise=0.3):
    """Points x (N, 3) of three labels and their noisy images y (F, N, 3) under a motion a label and frame."""
    rng = np.random.default_rng(seed)
    x, label = rng.normal((4.0, 0, -2), size=(60, 3)), np.arange(60) % 3
    T = exp_se3(rng.normal(size=(4, 3, 6)))
    return x, transform(T[:, label], x) + noise * rng.normal(size=(4, 60, 3)), label, T


def kabsch(x, y):
    """Squared error and rigid motion (4, 4) of the best fit of x to y, by scipy."""
    rotation, rssd = Rotation.align_vectors(y - y.mean(axis=0), x - x.mean(axis=0))
    T = np.eye(4)
    T[:3, :3] = rotation.as_matrix()
    T[:3, 3] = y.mean(axis=0) - T[:3, :3] @ x.mean(axis=0)
    return rssd**2, T


@pytest.mark.parametrize("noise", [0.05, 0.3, 3.0])
def test_error_and_motion_of_every_label_and_frame(noise):
    x, y, label, _ = scattered(noise=noise)
    stats = moments(x, y, label, 3)
    error, T = stats.squared_error(), stats.motion()
    for k in range(3):
        for f in range(4):
            expected_error, expected_T = kabsch(x[label == k], y[f, label == k])
            assert error[k, f] == pytest.approx(expected_error, rel=1e-6)
            np.testing.assert_allclose(T[k, f], expected_T, atol=1e-6)


def test_a_mirror_image_is_no_rigid_motion():
    x = np.random.default_rng(1).normal(size=(50, 3)) * [3, 2, 1]
    y = (x * [1, 1, -1])[None]
    stats = moments(x, y, np.zeros(50, int), 1)
    expected, T = kabsch(x, y[0])
    assert expected > 10
    assert stats.squared_error()[0, 0] == pytest.approx(expected)
    assert np.linalg.det(stats.motion()[0, 0, :3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(stats.motion()[0, 0], T, atol=1e-6)


def test_exact_motions_have_no_error():
    x, y, label, T = scattered(noise=0.0)
    stats = moments(x, y, label, 3)
    np.testing.assert_allclose(stats.squared_error(), 0.0, atol=1e-9)
    np.testing.assert_allclose(stats.motion(), np.swapaxes(T, 0, 1), atol=1e-9)


def test_sums_of_moments_are_the_moments_of_the_union():
    x, y, label, _ = scattered()
    stats = moments(x, y, label, 3)
    union = stats.take([0]).plus(stats.take([2]))
    mine = label != 1
    for a, b in zip(union.fields(), moments(x[mine], y[:, mine], np.zeros(40, int), 1).fields(), strict=True):
        np.testing.assert_allclose(a, b)
    stats.store(0, union)
    np.testing.assert_allclose(stats.n, [40, 20, 20])


def test_labels_touch_along_a_line():
    points = np.column_stack([np.arange(40.0), np.zeros((40, 2))])
    assert adjacent_labels(points, np.arange(40) // 10, neighbours=3) == {(0, 1), (1, 2), (2, 3)}


@pytest.fixture(autouse=True)
def few_patches(monkeypatch):
    """Patches of twenty points."""
    monkeypatch.setattr(patches, "MIN_NODES", 60)
    monkeypatch.setattr(patches, "MAX_NODES", 60)


def plate(bend):
    """A plate of 1200 points whose right half turns by `bend` a frame about the middle line, perfectly tracked."""
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(0, 40, 1200), rng.uniform(0, 30, 1200), np.zeros(1200)])
    whole = patches.make_patches(points, np.tile([0.0, 0, 1], (1200, 1)))
    centre = np.stack([points[whole.owner == k].mean(axis=0) for k in range(whole.count)])
    half = (centre[:, 0] > 20).astype(int)
    motion = exp_se3(np.arange(4)[:, None] * bend * np.array([0, 1.0, 0, 0, 0, 20]))
    both = np.stack([np.tile(np.eye(4), (4, 1, 1)), motion], axis=1)
    return patches.Tracks(whole, both[:, half]), half[whole.owner], both


def test_two_halves_that_move_rigidly_become_two_clusters():
    tracks, half, motion = plate(0.3)
    labels, T = cluster(tracks, FitConfig().fragment_penalty, FitConfig().max_fragments)
    assert T.shape == (4, 2, 4, 4)
    assert rand_index(labels, half) == 1.0
    np.testing.assert_allclose(T[:, [labels[half == 0][0], labels[half == 1][0]]], motion, atol=1e-9)


def test_a_plate_at_rest_becomes_one_cluster():
    tracks, _, _ = plate(0.0)
    labels, T = cluster(tracks, FitConfig().fragment_penalty, FitConfig().max_fragments)
    assert (labels == 0).all()
    np.testing.assert_allclose(T[:, 0], np.tile(np.eye(4), (4, 1, 1)), atol=1e-9)
