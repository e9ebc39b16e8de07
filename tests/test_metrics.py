"""A perfect fit scores perfectly, a fit with a known flaw scores exactly that flaw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from oracle import perfect_fit, read_pair
from rearticulate.errors import InputError
from rearticulate.evaluation.clustering import contingency, rand_index
from rearticulate.evaluation.joints import (
    angle_of_lines,
    existing_joints,
    joint_errors,
    match_parts,
    motion_error,
)
from rearticulate.evaluation.metrics import clicks, evaluate, flow_accuracy
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.records import GroundTruth, PointSequence

labellings = arrays(np.int64, 30, elements=st.integers(0, 4))


def hinge(frames=3, points=40, world=None):
    """Two plates, a hinge along z through (1, 0, 0) that turns by 0.3 a frame; points differ from frame to frame.

    world: (F, 4, 4) motion of the root, still by default.
    """
    rng = np.random.default_rng(0)
    world = np.tile(np.eye(4), (frames, 1, 1)) if world is None else world
    step = np.array([0, 0, 1.0, 0, -1.0, 0])
    poses = np.stack([world, world @ exp_se3(0.3 * np.arange(frames)[:, None] * step)], axis=1)
    labels = tuple(rng.permutation(np.repeat([0, 1], points // 2)) for _ in range(frames))
    clouds = []
    for T, part in zip(poses, labels, strict=True):
        x = rng.uniform(-0.2, 0.2, (points, 3)) + np.where(part[:, None] == 1, [1.7, 0, 0], [0.3, 0, 0])
        clouds.append(transform(T[part], x))
    truth = GroundTruth(
        labels=labels,
        poses=poses,
        parent=np.array([-1, 0]),
        novel=np.stack([np.eye(4), exp_se3(0.45 * step)])[None],
        joint_type=("", "revolute"),
        joint_axis=np.array([[0, 0, 0], [0, 0, 1.0]]),
        joint_point=np.array([[0, 0, 0], [1.0, 0, 5]]),
        joint_state=0.3 * np.arange(frames)[:, None] * np.array([0, 1.0]),
    )
    return PointSequence.from_arrays(clouds), truth


def scores(result, truth, sequence):
    return {m.key: m.value for m in evaluate(result, truth, sequence)}


PERFECT = {
    "recon_cm": 0,
    "flow_epe_cm": 0,
    "flow_acc_5mm": 1,
    "flow_acc_10mm": 1,
    "flow_acc_5cm": 1,
    "flow_acc_10cm": 1,
    "rand_index": 1,
    "rand_index_multi_scan": 1,
    "rand_index_per_scan": 1,
    "tree_edit_distance": 0,
    "joint_type_share": 1,
    "true_edges_share": 1,
    "tree_edit_distance_best_root": 0,
    "tree_and_types": 1,
    "exact": 1,
    "joint_axis_median_deg": 0,
    "joint_position_median_percent": 0,
}


def assert_perfect(found, parts):
    for key, value in PERFECT.items():
        assert found[key] == pytest.approx(value, abs=1e-5), key
    assert found["parts"] == found["parts_true"] == parts


@pytest.mark.parametrize("canonical", [0, 1, 2])
def test_a_perfect_fit_of_a_hinge(canonical):
    sequence, truth = hinge(world=exp_se3(np.random.default_rng(1).normal(size=(3, 6)) * [[0], [1], [1]]))
    found = scores(perfect_fit(sequence, truth, canonical), truth, sequence)
    assert_perfect(found, 2)


@pytest.mark.parametrize("name", ["roboart/reachy", "roboart/solo", "household/cabinet"])
def test_a_perfect_fit_of_real_sequences(data_folder, name):
    sequence, truth = read_pair(data_folder / f"{name}.npz")
    found = scores(perfect_fit(sequence, truth, 2), truth, sequence)
    assert_perfect(found, len(truth.parent))
    if name.startswith("roboart"):  # three or four clicks cannot tell how the root of a cupboard moved
        assert found["reanimate_cm"] < 0.3


def test_a_perfect_fit_of_some_of_the_points():
    sequence, truth = hinge()
    rng = np.random.default_rng(4)
    rows = [rng.permutation(40)[: 25 + f] for f in range(3)]
    fewer = PointSequence(tuple(p[r] for p, r in zip(sequence.points, rows, strict=True)), tuple(rows), sequence.names)
    assert_perfect(scores(perfect_fit(fewer, truth, 1), truth, fewer), 2)


@given(st.permutations(range(3)), st.integers(0, 50))
def test_part_numbers_do_not_matter(order, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.integers(0, 3, 50), rng.integers(0, 3, 50)
    assert rand_index(a, np.array(order)[b]) == pytest.approx(rand_index(a, b))


def test_which_part_is_the_root_does_not_matter_to_any_metric_where_the_root_moves():
    sequence, truth = hinge(world=exp_se3(np.random.default_rng(1).normal(size=(3, 6)) * [[0], [1], [1]]))
    result = perfect_fit(sequence, truth, 1)
    # the mirror model: the true child is the root, its parent swings about the same axis
    model = replace(result.model, labels=1 - result.model.labels, axis=-result.model.axis)
    child = truth.poses[:, 1] @ inverse(truth.poses[1, 1])
    swapped = replace(
        result,
        model=model,
        labels=tuple(1 - part for part in result.labels),
        motion=replace(result.motion, T_world_root=child),
    )
    assert_perfect(scores(swapped, truth, sequence), 2)


def test_a_root_that_is_off_by_a_centimetre():
    sequence, truth = hinge()
    result = perfect_fit(sequence, truth)
    root = result.motion.T_world_root.copy()
    root[1, 0, 3] += 0.01
    found = scores(replace(result, motion=replace(result.motion, T_world_root=root)), truth, sequence)
    assert found["recon_cm"] == pytest.approx(1 / 3)  # one frame of three
    assert found["flow_epe_cm"] == pytest.approx(1.0)  # to the frame and from it
    assert found["flow_acc_5mm"] == 0
    assert found["flow_acc_5cm"] == 1


def test_a_fit_of_one_part():
    sequence, truth = hinge()
    labels = tuple(0 * part for part in truth.labels)
    alone = GroundTruth(labels, truth.poses[:, :1], np.array([-1]), truth.novel[:, :1])
    result = perfect_fit(sequence, alone)
    found = scores(result, truth, sequence)
    assert (found["parts"], found["parts_true"]) == (1, 2)
    assert found["rand_index"] == found["rand_index_multi_scan"] == found["rand_index_per_scan"] == 0.5
    assert found["tree_edit_distance"] == 1
    assert found["joint_type_share"] == 0
    assert "joint_axis_median_deg" not in found
    swing = transform(truth.poses[:, 1], sequence.points[0][:, None]) - sequence.points[0][:, None]
    moving = np.linalg.norm(swing, axis=-1)[truth.labels[0] == 1]
    assert found["recon_cm"] == pytest.approx(100 * moving.sum() / (40 * 3))


def test_joint_errors_by_hand():
    sequence, truth = hinge()
    result = perfect_fit(sequence, truth)
    tilt = np.array([[0, 0, 0], [0, np.sin(0.2), np.cos(0.2)]])
    origin = np.array([[0, 0, 0], [1.0, 0.03, 0.1]])
    worse = replace(result, model=replace(result.model, axis=-tilt, origin=origin))
    (error,) = joint_errors(worse, truth, np.array([0, 1]))
    assert (error.true, error.predicted, error.type_right) == (1, 1, True)
    assert error.axis_rad == pytest.approx(0.2)
    assert error.position_m == pytest.approx(0.03)
    diagonal = np.linalg.norm(np.ptp(sequence.points[0], axis=0))
    found = scores(worse, truth, sequence)
    assert found["joint_axis_median_deg"] == pytest.approx(np.degrees(0.2))
    assert found["joint_position_median_percent"] == pytest.approx(3 / diagonal)
    unsure = replace(worse, joints=tuple(replace(j, determined=False) for j in worse.joints))
    assert "joint_axis_median_deg" not in scores(unsure, truth, sequence)
    assert (found["joints_sure_share"], found["joints_sure_wrong"]) == (1, 0)
    assert scores(unsure, truth, sequence)["joints_sure_share"] == 0
    slide = replace(worse, model=replace(worse.model, joint_type=("floating", "prismatic")))
    wrong = scores(slide, truth, sequence)
    assert (wrong["joint_type_share"], wrong["joints_sure_share"], wrong["joints_sure_wrong"]) == (0, 0, 1)


def test_a_joint_within_a_rigid_part_does_not_exist_unless_nobody_claims_it():
    """The arm is cut in two: the cut is made up, the joint of its first half is real."""
    sequence, truth = hinge()
    result = perfect_fit(sequence, truth)
    labels = tuple(np.where((k == 1) & (np.arange(len(k)) % 3 == 0), 2, k) for k in truth.labels)
    q = np.concatenate([result.motion.q, np.zeros((len(labels), 1))], axis=1)
    arms = [0, 1, 1]
    model = replace(
        result.model,
        parent=np.array([-1, 0, 1]),
        joint_type=("floating", "revolute", "revolute"),
        axis=result.model.axis[arms],
        origin=result.model.origin[arms],
        limits=np.stack([q.min(axis=0), q.max(axis=0)], axis=1),
        names=("base", "arm", "piece"),
        labels=labels[result.model.canonical],
    )
    joints = tuple(result.joints[j] for j in arms)
    cut = replace(result, model=model, motion=replace(result.motion, q=q), labels=labels, joints=joints)
    errors = joint_errors(cut, truth, match_parts(cut, truth, list(truth.labels)))
    assert existing_joints(cut, truth, list(truth.labels), errors).tolist() == [True, True, False]
    assert scores(cut, truth, sequence)["joints_sure_wrong"] == 1
    honest = replace(cut, joints=(*joints[:2], replace(joints[2], determined=False)))
    assert scores(honest, truth, sequence)["joints_sure_wrong"] == 0


def test_no_joint_metrics_without_true_joints():
    sequence, truth = hinge()
    bare = replace(truth, joint_type=None, joint_axis=None, joint_point=None, joint_state=None)
    assert not any(key.startswith("joint") for key in scores(perfect_fit(sequence, truth), bare, sequence))


@given(labellings, labellings)
def test_rand_index_counts_pairs(a, b):
    agree = (a[:, None] == a) == (b[:, None] == b)
    assert rand_index(a, b) == pytest.approx(agree.mean())


def test_rand_index_by_hand():
    assert rand_index(np.array([0, 0, 1, 1]), np.array([0, 0, 0, 1])) == pytest.approx(10 / 16)
    assert contingency(np.array([0, 0, 1]), np.array([1, 1, 0])).tolist() == [[0, 2], [1, 0]]


def test_parts_are_matched_by_their_motion_not_by_most_points():
    sequence, truth = hinge()
    result = perfect_fit(sequence, truth, 1)
    rng = np.random.default_rng(3)
    mostly_swapped = tuple(np.where(rng.random(len(k)) < 0.8, 1 - k, k) for k in truth.labels)
    muddled = replace(result, labels=mostly_swapped, model=replace(result.model, labels=mostly_swapped[1]))
    assert match_parts(muddled, truth, list(truth.labels)).tolist() == [0, 1]
    assert scores(muddled, truth, sequence)["joint_type_share"] == 1


def test_a_part_without_common_points_has_no_match():
    sequence, truth = hinge()
    result = perfect_fit(sequence, truth, 1)
    swallowed = tuple(np.zeros_like(k) for k in truth.labels)
    one = replace(result, labels=swallowed, model=replace(result.model, labels=swallowed[1]))
    assert match_parts(one, truth, list(truth.labels)).tolist() == [0, -1]


def test_motion_error_is_the_root_mean_square_distance():
    rng = np.random.default_rng(8)
    predicted, true, x = exp_se3(rng.normal(size=(4, 3, 6))), exp_se3(rng.normal(size=(4, 6))), rng.normal(size=(20, 3))
    gap = transform(predicted[:, :, None], x[None, None]) - transform(true[:, None, None], x[None, None])
    expected = np.sqrt((gap**2).sum(axis=-1).mean(axis=(0, 2)))
    np.testing.assert_allclose(motion_error(predicted, true, x), expected, rtol=1e-12)


def test_flow_accuracy_takes_the_better_of_absolute_and_relative_error():
    error, length = np.array([0.004, 0.006, 0.05, 0.05]), np.array([0.0, 0.1, 20.0, 2.0])
    assert flow_accuracy(error, length, 0.005) == 0.5
    assert flow_accuracy(error, length, 0.025) == 1.0


def test_clicks_are_points_of_the_file_not_of_the_subsample():
    labels, index = np.array([0, 1, 0, 0, 2]), np.array([30, 2, 10, 20, 7])
    assert labels[clicks(labels, index, 4)].tolist() == [0, 1, 2]
    assert clicks(labels, index, 4).tolist() == [0, 1, 4]  # the last one in file order where there are few
    many = np.zeros(40, dtype=np.int64)
    assert clicks(many, np.arange(40)[::-1], 1).tolist() == [29]


def test_angle_of_lines():
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    assert angle_of_lines(x, -x) == 0
    assert angle_of_lines(x, y) == pytest.approx(np.pi / 2)
    assert angle_of_lines(x, 0 * x) == pytest.approx(np.pi / 2)
    assert angle_of_lines(x, x + 1e-9 * y) == pytest.approx(1e-9, rel=1e-3)


def test_a_result_of_another_sequence_is_refused():
    sequence, truth = hinge()
    result = perfect_fit(sequence, truth)
    short = PointSequence(sequence.points[:2], sequence.index[:2], sequence.names[:2])
    with pytest.raises(InputError, match="2 frames"):
        evaluate(result, truth, short)
    halved = PointSequence.from_arrays([p[::2] for p in sequence.points])
    with pytest.raises(InputError, match="40 points"):
        evaluate(result, truth, halved)
    few_labels = replace(truth, labels=tuple(part[:30] for part in truth.labels))
    with pytest.raises(InputError, match="point number 39"):
        evaluate(result, few_labels, sequence)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"parent": np.array([1, 0])}, "one root"),
        ({"parent": np.array([-1, 1])}, "without cycles"),
        ({"parent": np.array([-1, -1])}, "one root"),
        ({"parent": np.array([-1, 5])}, "parent must be"),
        ({"joint_type": ("", "helical")}, "not known"),
        ({"joint_axis": np.array([[0, 0, 0], [0, 0, 2.0]])}, "length 1"),
        ({"joint_state": np.full((3, 2), np.nan)}, "finite"),
        ({"poses": np.zeros((3, 2, 4, 4))}, "rigid"),
        ({"novel": np.zeros((1, 3, 4, 4))}, "novel has shape"),
        ({"labels": (np.full(40, 2),) * 3}, "from 0 to 1"),
    ],
)
def test_a_truth_that_is_none_is_refused(changes, expected):
    with pytest.raises(InputError, match=expected):
        replace(hinge()[1], **changes)
