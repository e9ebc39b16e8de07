"""The paper's rules for merging and projecting: with true motions they give the true tree, exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from oracle import in_spacings, read_pair
from rearticulate.config import DeviationConfig
from rearticulate.evaluation.tree_distance import tree_edit_distance
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.joints.tree import choose_root
from rearticulate.methods.deviation import centred, merge_still, project_deviation
from rearticulate.observe.frames import make_frames
from rearticulate.parts.relaxed import Relaxed
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import arm, cabinet

CONFIG = DeviationConfig()


def true_model(sequence, truth, canonical=2, shuffle=None):
    """Frames and the true relaxed model, its parts in any order."""
    frames = make_frames(sequence.points)
    labels = np.concatenate(truth.labels)[frames.order]
    T = in_spacings(frames, truth.poses, canonical)
    order = np.arange(T.shape[1]) if shuffle is None else np.random.default_rng(shuffle).permutation(T.shape[1])
    return frames, Relaxed(T[:, order], np.argsort(order)[labels])


def project_all(frames, model, canonical=2):
    root = choose_root(frames, canonical, model)
    projection, cost = project_deviation(frames, canonical, model, CONFIG, root)
    return projection.tree, projection.starts[0], cost


@pytest.mark.parametrize(("thing", "step"), [(arm(), 12.0), (cabinet(), 20.0)], ids=["arm", "cabinet"])
@pytest.mark.parametrize("shuffle", [0, 1])
def test_true_motions_give_the_true_tree(thing, step, shuffle):
    sequence, truth = record(thing, frames=6, points=1500, step_deg=step, seed=1)
    frames, model = true_model(sequence, truth, shuffle=shuffle)
    tree, labels, _ = project_all(frames, model)
    assert tree_edit_distance(tree.parent, truth.parent) == 0
    rows = frames.rows(2)
    moved = transform(tree.forward()[:, labels[rows]], frames.points[rows])
    np.testing.assert_allclose(moved, model.moved_points(frames, 2), atol=1e-6)
    kinds = {truth.joint_type[p] for p in range(1, len(truth.parent))}
    assert set(np.where(tree.revolute[1:], "revolute", "prismatic")) == kinds


@pytest.mark.parametrize("name", ["nao", "panda", "a1", "icub", "allegro", "solo", "jvrc"])
def test_true_motions_of_robots_give_their_trees(data_folder, name):
    sequence, truth = read_pair(data_folder / "roboart" / f"{name}.npz")
    frames, model = true_model(sequence, truth, canonical=5)
    merged = merge_still(frames, 5, model, CONFIG)
    assert merged.n_parts == len(truth.parent)
    tree, _, _ = project_all(frames, merged, canonical=5)
    assert tree_edit_distance(tree.parent, truth.parent) == 0


def test_pieces_of_a_part_are_merged_and_far_parts_are_not():
    """Cut the arm's base in two: the pieces touch and stay together. Parts that do so from afar stay apart."""
    sequence, truth = record(arm(), frames=5, points=1500, step_deg=15, seed=3)
    frames, model = true_model(sequence, truth)
    base = model.labels == 0
    cut = frames.points[:, 0] > np.median(frames.points[base, 0])
    pieces = Relaxed(
        np.concatenate([model.T, model.T[:, :1]], axis=1), np.where(base & cut, model.n_parts, model.labels)
    )
    merged = merge_still(frames, 2, pieces, CONFIG)
    assert merged.n_parts == model.n_parts
    agree = np.unique(np.stack([merged.labels, model.labels]), axis=1)
    assert agree.shape[1] == model.n_parts

    tip = model.n_parts - 1
    far = Relaxed(model.T.copy(), model.labels)
    far.T[:, tip] = far.T[:, 0]
    assert merge_still(frames, 2, far, CONFIG).n_parts == model.n_parts


def test_the_deviation_is_that_of_the_matrices():
    """For a small motion: mean over the frames of |A - I|^2, lengths in the paper's unit, about the centroid."""
    sequence, truth = record(arm(), frames=4, points=800, seed=0)
    frames, model = true_model(sequence, truth)
    rng = np.random.default_rng(0)
    small = exp_se3(rng.normal(size=(4, 6)) * np.r_[np.full(3, 1e-3), np.full(3, 0.05)])
    small[2] = np.eye(4)
    twin = Relaxed(np.stack([model.T[:, 0], model.T[:, 0] @ small], axis=1), model.labels % 2)
    parts = centred(frames, 2, twin, CONFIG.radius)
    from rearticulate.joints.chains import rest_cost

    measured = parts.deviation(rest_cost(*parts.relative(np.array([1]), np.array([0]))))[0]
    shift = np.eye(4)
    shift[:3, 3] = parts.centre
    A = inverse(shift) @ small @ shift
    A[:, :3, 3] *= parts.scale
    expected = ((A - np.eye(4)) ** 2).sum(axis=(1, 2))[[0, 1, 3]].mean()
    assert measured == pytest.approx(expected, rel=1e-3)
    radius = np.sqrt((parts.points**2).sum(axis=1).mean()) * parts.scale
    assert radius == pytest.approx(CONFIG.radius)


def test_costs_do_not_depend_on_the_world_or_the_unit():
    sequence, truth = record(cabinet(), frames=5, points=900, seed=2)
    frames, model = true_model(sequence, truth)
    noise = exp_se3(np.random.default_rng(0).normal(size=(*model.T.shape[:2], 6)) * np.r_[[0.02] * 3, [0.5] * 3])
    noise[2] = np.eye(4)
    rough = Relaxed(noise @ model.T, model.labels)
    _, labels, cost = project_all(frames, rough)
    world = exp_se3(np.array([0.3, -0.8, 0.5, 2.0, -1.0, 4.0]))
    turned = make_frames([1000 * transform(world, p) for p in sequence.points])
    shift = np.eye(4)
    shift[:3, :3] = world[:3, :3]
    moved = Relaxed(shift @ rough.T @ inverse(shift), model.labels)
    _, again, cost_again = project_all(turned, moved)
    assert cost_again == pytest.approx(cost, rel=1e-6)
    np.testing.assert_array_equal(labels, again)


def test_e_group_by_hand():
    sequence, truth = record(arm(), frames=3, points=500, seed=0)
    frames, model = true_model(sequence, truth)
    parts = centred(frames, 2, model, CONFIG.radius)
    x, spreads = parts.points * parts.scale, []
    for p in range(model.n_parts):
        own = x[parts.labels == p]
        spreads.append(((own - own.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert parts.spread() == pytest.approx(np.mean(spreads))


def test_one_part_is_a_tree():
    sequence, truth = record(arm(), frames=3, points=500, seed=0)
    frames, model = true_model(sequence, truth)
    single = Relaxed(model.T[:, :1], np.zeros_like(model.labels))
    tree, _, cost = project_all(frames, merge_still(frames, 2, single, replace(CONFIG, merge=9.0)))
    assert tree.n_parts == 1
    assert cost == 0
