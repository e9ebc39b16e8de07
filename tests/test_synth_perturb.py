"""Perturbed recordings stay consistent: the true motion carries points of one frame onto another frame's surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from oracle import assert_joints_explain_poses, read_pair
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth import perturb
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import arm, cabinet, random_tree

PERTURBATIONS = {
    "none": lambda s, t: (s, t),
    "noise": lambda s, t: perturb.add_noise(s, t, 0.001),
    "subset": lambda s, t: perturb.resample(s, t, 800),
    "dense": lambda s, t: perturb.resample(s, t, 4000),
    "random_half": lambda s, t: perturb.drop_random_half(s, t, 2),
    "one_sided_half": lambda s, t: perturb.drop_one_sided_half(s, t, 2),
    "one_sided": perturb.one_sided,
    "moving_root": perturb.moving_root,
    "other_world": perturb.other_world,
    "every_second": lambda s, t: perturb.every_nth_frame(s, t, 2),
    "reordered": lambda s, t: perturb.select_frames(s, t, [3, 1, 4]),
    "slow": lambda s, t: perturb.interpolate(s, t, 13),
}


@pytest.fixture(scope="module")
def recording() -> tuple[PointSequence, GroundTruth]:
    return record(cabinet(), frames=5, points=2000, seed=1)


def misfit(sequence: PointSequence, truth: GroundTruth, a: int, b: int) -> float:
    """Median distance of frame a's points, moved to frame b by the truth, to frame b's points of the same part."""
    labels = perturb.point_labels(sequence, truth)
    distances = []
    for p in np.intersect1d(labels[a], labels[b]):
        moved = transform(truth.poses[b, p] @ inverse(truth.poses[a, p]), sequence.points[a][labels[a] == p])
        distances.append(cKDTree(sequence.points[b][labels[b] == p]).query(moved)[0])
    return float(np.median(np.concatenate(distances)))


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_truth_moves_points_onto_the_surface_of_other_frames(name, recording):
    sequence, truth = PERTURBATIONS[name](*recording)
    spacing = np.median(cKDTree(sequence.points[0]).query(sequence.points[0], k=2)[0][:, 1])
    assert len(sequence) == len(truth.poses) == len(truth.labels) == len(truth.joint_state)
    assert all(len(p) == len(q) for p, q in zip(sequence.points, truth.labels, strict=True))
    for a, b in ((0, len(sequence) - 1), (1, 0)):
        assert misfit(sequence, truth, a, b) < 1.5 * spacing


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_true_joints_still_explain_the_true_poses(name, recording):
    _, truth = PERTURBATIONS[name](*recording)
    np.testing.assert_allclose(truth.poses[0], np.broadcast_to(np.eye(4), truth.poses[0].shape), atol=1e-12)
    assert_joints_explain_poses(truth)


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_perturbations_reproduce_bit_for_bit(name, recording):
    first, again = (PERTURBATIONS[name](*recording) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first[0].points, again[0].points, strict=True))
    assert np.array_equal(first[1].poses, again[1].poses)


def test_points_change_by_the_noise_alone(recording):
    noisy, _ = perturb.add_noise(*recording, 0.002)
    error = np.concatenate(noisy.points) - np.concatenate(recording[0].points)
    assert error.std() == pytest.approx(0.002, rel=0.05) and abs(error.mean()) < 1e-4


def test_sizes(recording):
    sizes = {name: [len(p) for p in PERTURBATIONS[name](*recording)[0].points] for name in PERTURBATIONS}
    assert sizes["subset"] == [800] * 5 and sizes["dense"] == [4000] * 5
    assert sizes["random_half"] == sizes["one_sided_half"] == [2000, 2000, 1000, 2000, 2000]
    assert sizes["every_second"] == [2000] * 3 and sizes["slow"] == [2000] * 13
    assert all(0.1 * 2000 < n < 0.6 * 2000 for n in sizes["one_sided"])


def test_one_sided_half_is_cut_by_a_plane(recording):
    half = perturb.drop_one_sided_half(*recording, 2, seed=3)[0].points[2]
    assert np.linalg.norm(half.mean(axis=0) - recording[0].points[2].mean(axis=0)) > 0.1


def test_dropped_and_reordered_points_keep_their_labels(recording):
    sequence, truth = recording
    rows = tuple(np.random.default_rng(f).permutation(2000)[:1500] for f in range(5))
    thinned = PointSequence(tuple(p[r] for p, r in zip(sequence.points, rows, strict=True)), rows, sequence.names)
    subset, labels = perturb.subsample(thinned, truth, 1000)
    whole = cKDTree(sequence.points[4])
    distance, row = whole.query(subset.points[4])
    assert distance.max() == 0 and np.array_equal(labels.labels[4], truth.labels[4][row])


def test_interpolation_passes_through_the_old_frames_and_keeps_the_joints():
    _, truth = record(random_tree(7, seed=2), frames=4, points=8, moving_root=True)
    times = np.linspace(0, 3, 7)
    poses = perturb.interpolated_poses(truth.poses, truth.parent, times)
    np.testing.assert_allclose(poses[::2], truth.poses, atol=1e-12)
    assert np.abs(poses[1] - poses[0]).max() > 1e-3


def test_the_first_selected_frame_is_the_new_frame_zero():
    sequence, truth = record(arm(), frames=4, points=50, moving_root=True)
    _, selected = perturb.select_frames(sequence, truth, [2, 0, 3])
    back = selected.poses @ truth.poses[2]
    np.testing.assert_allclose(back, truth.poses[[2, 0, 3]], atol=1e-12)
    np.testing.assert_allclose(selected.novel @ truth.poses[2], truth.novel, atol=1e-12)


@pytest.mark.parametrize("name", ["roboart/nao", "roboart/reachy", "household/cabinet"])
def test_real_sequences(name, data_folder):
    sequence, truth = read_pair(data_folder / f"{name}.npz")
    for change in (
        lambda s, t: perturb.every_nth_frame(s, t, 2),
        lambda s, t: perturb.interpolate(s, t, 9),
        perturb.moving_root,
    ):
        changed, known = change(sequence, truth)
        spacing = np.median(cKDTree(changed.points[0]).query(changed.points[0], k=2)[0][:, 1])
        assert misfit(changed, known, 0, len(changed) - 1) < 1.5 * spacing
