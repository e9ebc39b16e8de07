"""Fits made from the truth, each broken in one way: the measures of structure lose exactly what is broken."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle import perfect_fit
from rearticulate.evaluation.joints import JointError, axis_z_scores
from rearticulate.evaluation.metrics import evaluate
from rearticulate.evaluation.structure import root_moves, structure
from rearticulate.evaluation.tree_distance import rerooted, tree_edit_distance, tree_edit_distance_best_root
from rearticulate.records import FitResult, GroundTruth, PointSequence
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import arm, cabinet, random_tree
from rearticulate.synth.perturb import other_world

KEYS = ("exact", "tree_and_types", "tree_edit_distance_best_root", "true_edges_share")


def scores(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> dict[str, float]:
    return {m.key: m.value for m in evaluate(result, truth, sequence)}


def four(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> tuple[float, ...]:
    found = scores(result, truth, sequence)
    return tuple(found[key] for key in KEYS)


def recorded(thing, moving_root=False):
    return record(thing, frames=4, points=600, moving_root=moving_root)


def renumbered(truth: GroundTruth, order: list[int]) -> GroundTruth:
    """The same truth, its parts in another order: number k is the old order[k]."""
    new = np.argsort(order)
    parent = truth.parent[order]
    return GroundTruth(
        labels=tuple(new[labels] for labels in truth.labels),
        poses=truth.poses[:, order],
        parent=np.where(parent >= 0, new[parent], -1),
        novel=truth.novel[:, order],
    )


def rooted_at(truth: GroundTruth, root: int) -> GroundTruth:
    """The same truth under another root, parents before children."""
    parent = rerooted(truth.parent, root)
    order = [root]
    for node in order:
        order += np.flatnonzero(parent == node).tolist()
    bare = replace(truth, parent=parent, joint_type=None, joint_axis=None, joint_point=None, joint_state=None)
    return renumbered(bare, order)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("thing", [arm(), cabinet(), random_tree(7, seed=2), random_tree(7, seed=5)])
def test_the_truth_is_exact(thing, moving):
    sequence, truth = recorded(thing, moving)
    assert root_moves(truth) == moving
    assert four(perfect_fit(sequence, truth, 1), truth, sequence) == (1, 1, 0, 1)


def test_numbers_of_parts_do_not_matter():
    sequence, truth = recorded(cabinet())
    assert four(perfect_fit(sequence, renumbered(truth, [0, 2, 1]), 1), truth, sequence) == (1, 1, 0, 1)


def test_a_root_that_moves_may_be_any_part():
    for thing, root in ((arm(), 3), (random_tree(7, seed=2), 5), (cabinet(), 2)):
        sequence, truth = recorded(thing, moving_root=True)
        result = perfect_fit(sequence, rooted_at(truth, root), 1)
        assert four(result, truth, sequence) == (1, 1, 0, 1)


def test_a_root_at_rest_is_known():
    sequence, truth = recorded(arm())
    result = perfect_fit(sequence, rooted_at(truth, 2), 1)  # in the middle of the chain of five
    assert four(result, truth, sequence) == (0, 0, tree_edit_distance(result.model.parent, truth.parent), 1)
    mirrored = perfect_fit(sequence, rooted_at(truth, 4), 1)  # the same shape, other way round
    assert four(mirrored, truth, sequence) == (0, 1, 0, 1)


def test_a_swapped_type_loses_one_edge():
    sequence, truth = recorded(arm())
    result = perfect_fit(sequence, truth, 1)
    kinds = ("floating", "revolute", "prismatic", "revolute", "revolute")
    swapped = replace(result, model=replace(result.model, joint_type=kinds))
    assert four(swapped, truth, sequence) == (0, 0, 0, 3 / 4)
    untold = replace(truth, joint_type=None, joint_axis=None, joint_point=None, joint_state=None)
    assert four(swapped, untold, sequence) == (1, 1, 0, 1)


def test_a_wrong_parent_loses_one_edge():
    sequence, truth = recorded(arm())
    wrong = np.array([-1, 0, 1, 2, 2])
    assert four(perfect_fit(sequence, replace(truth, parent=wrong), 1), truth, sequence) == (0, 0, 2, 3 / 4)


def test_the_right_shape_of_the_wrong_parts_is_not_exact():
    sequence, truth = recorded(arm(2))
    crossed = renumbered(replace(truth, parent=np.array([-1, 2, 0])), [0, 2, 1])
    assert four(perfect_fit(sequence, crossed, 1), truth, sequence) == (0, 1, 0, 1 / 2)


def test_an_extra_part_loses_no_edge():
    sequence, truth = recorded(arm())
    labels = tuple(np.where((k == 4) & (np.arange(len(k)) % 3 == 0), 5, k) for k in truth.labels)
    drift = np.tile(np.eye(4), (4, 1, 1))
    drift[:, 0, 3] = 0.001 * np.arange(4)  # m, along x
    poses = np.concatenate([truth.poses, truth.poses[:, 4:] @ drift[:, None]], axis=1)
    result = perfect_fit(sequence, GroundTruth(labels, poses, np.array([-1, 0, 1, 2, 3, 4]), poses[:0]), 1)
    assert four(result, truth, sequence) == (0, 0, 1, 1)


def test_a_missing_part_loses_its_edge():
    sequence, truth = recorded(arm())
    labels = tuple(np.minimum(k, 3) for k in truth.labels)
    fewer = GroundTruth(labels, truth.poses[:, :4], truth.parent[:4], truth.novel[:, :4])
    assert four(perfect_fit(sequence, fewer, 1), truth, sequence) == (0, 0, 1, 3 / 4)


def test_one_rigid_part_has_no_edges():
    sequence, truth = recorded(random_tree(1), moving_root=True)
    found = scores(perfect_fit(sequence, truth), truth, sequence)
    assert (found["exact"], found["tree_and_types"]) == (1, 1) and "true_edges_share" not in found


def test_another_world_frame_keeps_the_structure():
    sequence, truth = recorded(random_tree(6, seed=3))
    turned, told = other_world(sequence, truth)
    assert not root_moves(told) and four(perfect_fit(turned, told, 1), told, turned) == (1, 1, 0, 1)


def test_z_scores_of_axes_by_hand():
    sequence, truth = recorded(cabinet())
    result = perfect_fit(sequence, truth, 1)
    tilt = np.array([0.03, 0.04])  # rad
    across = np.array([[0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])
    axis = result.model.axis.copy()
    axis[1:] = np.cos(tilt)[:, None] * axis[1:] + np.sin(tilt)[:, None] * across[1:]
    told = [replace(joint, axis_std=std) for joint, std in zip(result.joints, (0.0, 0.01, 0.04), strict=True)]
    off = replace(result, model=replace(result.model, axis=axis), joints=tuple(told))
    found = scores(off, truth, sequence)
    assert found["axis_z_squared_sum"] == pytest.approx(3**2 + 1**2)
    assert (found["axis_z_count"], found["axis_z_rms"]) == (2, pytest.approx(np.sqrt(5)))
    unsure = replace(off, joints=(*told[:2], replace(told[2], determined=False)))
    assert scores(unsure, truth, sequence)["axis_z_rms"] == pytest.approx(3)
    silent = replace(off, joints=tuple(replace(j, axis_std=None) for j in told))
    assert not any(key.startswith("axis_z") for key in scores(silent, truth, sequence))


def test_honest_deviations_have_z_scores_of_one():
    sequence, truth = recorded(cabinet())
    result = perfect_fit(sequence, truth)
    std = 0.01  # of each of the two components
    joints = (result.joints[0], replace(result.joints[1], axis_std=std * np.sqrt(2)), result.joints[2])
    off = std * np.linalg.norm(np.random.default_rng(0).normal(size=(20_000, 2)), axis=1)
    z = axis_z_scores([JointError(1, 1, True, float(a), 0.0) for a in off], replace(result, joints=joints))
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.02)


@st.composite
def typed_trees(draw, max_nodes=5):
    n = draw(st.integers(1, max_nodes))
    parent = np.array([-1] + [draw(st.integers(0, j - 1)) for j in range(1, n)])
    return parent, ["", *(draw(st.sampled_from("rp")) for _ in range(1, n))]


@given(typed_trees(), typed_trees(), st.booleans())
def test_structures_are_equal_exactly_where_some_renumbering_makes_the_trees_equal(a, b, any_root):
    def joints(parent, kinds, number):
        ends = frozenset if any_root else tuple
        return {(ends((number[j], number[p])), kinds[j]) for j, p in enumerate(parent) if p >= 0}

    n = len(a[0])
    true = joints(*b, range(len(b[0])))
    same = n == len(b[0]) and any(joints(*a, number) == true for number in permutations(range(n)))
    assert (structure(*a, any_root) == structure(*b, any_root)) == same


@given(typed_trees(7), typed_trees(7))
def test_the_best_root_is_the_best_of_all_roots(a, b):
    parent, other = a[0], b[0]
    every = [tree_edit_distance(rerooted(parent, root), other) for root in range(len(parent))]
    assert tree_edit_distance_best_root(parent, other) == min(every)
    assert {tree_edit_distance_best_root(rerooted(other, root), other) for root in range(len(other))} == {0}
