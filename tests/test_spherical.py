"""Ball joints: closed forms, the model's kinematics, retargeting, and a whole fit of a figure with exact answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.config import DeviationConfig, preset
from rearticulate.evaluation.metrics import evaluate
from rearticulate.evaluation.tree_distance import tree_edit_distance
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.io.model import load_result, save_result
from rearticulate.joints.tree import choose_root
from rearticulate.methods.deviation import centred
from rearticulate.methods.spherical import fit_balls, project_balls
from rearticulate.observe.frames import make_frames
from rearticulate.parts.relaxed import Relaxed
from rearticulate.posing.single import single_valued
from rearticulate.records import KinematicModel
from rearticulate.retargeting.retarget import retarget
from rearticulate.synth.balls import PARENT, record_figure

C = 2


@pytest.fixture(scope="module")
def figure():
    sequence, truth, centre = record_figure(frames=6, points=1500, step_deg=15, seed=1)
    frames = make_frames(sequence.points)
    labels = np.concatenate(truth.labels)[frames.order]
    return sequence, truth, centre, frames, Relaxed(in_spacings(frames, truth.poses, C), labels)


def ball_model(seed=0, extra=True):
    """A chain of balls, and a hinge at its end."""
    rng = np.random.default_rng(seed)
    kinds = ("floating", "spherical", "spherical", "revolute" if extra else "spherical")
    origin = np.cumsum(rng.uniform(0.2, 0.5, (4, 3)), axis=0)
    axis = np.zeros((4, 3))
    axis[3] = [0, 0.6, 0.8] if extra else 0
    points = np.concatenate([o + 0.2 * rng.normal(size=(40, 3)) for o in origin])
    parent, labels = np.array([-1, 0, 1, 2]), np.repeat(np.arange(4), 40)
    limits = np.array([[0, 0], [0, 1.0], [0, 1.0], [-1.0, 1.0] if extra else [0, 1.0]])
    names = ("trunk", "arm", "hand", "finger")
    return KinematicModel(0, parent, kinds, axis, origin, limits, names, points, labels)


def test_values_have_places():
    model = ball_model()
    assert model.n_values == 8
    assert [model.values(j) for j in range(4)] == [[0], [1, 4, 5], [2, 6, 7], [3]]
    np.testing.assert_array_equal(model.forward(np.zeros(8)), np.broadcast_to(np.eye(4), (4, 4, 4)))


def test_hinges_in_place_of_balls_and_back():
    single, rng = single_valued(ball_model()), np.random.default_rng(3)
    q = rng.normal(size=(20, 8))
    q[:, 0] = 0
    hinges = single.hinges(q)
    T = single.model.forward(hinges)[:, single.number]
    np.testing.assert_allclose(T, single.original.forward(q), atol=1e-9)
    for row, own in zip(hinges, q, strict=True):
        np.testing.assert_allclose(single.original.forward(single.back(row)), single.original.forward(own), atol=1e-9)


def test_a_ball_turns_about_its_centre_by_its_rotation_vector():
    model, rng = ball_model(), np.random.default_rng(1)
    q = rng.normal(size=(5, 8))
    T = model.forward(q)
    step = inverse(T[:, 1]) @ T[:, 2]
    np.testing.assert_allclose(transform(step, model.origin[2]), np.broadcast_to(model.origin[2], (5, 3)), atol=1e-12)
    turn = np.zeros((5, 6))
    turn[:, :3] = q[:, model.values(2)]
    np.testing.assert_allclose(step[:, :3, :3], exp_se3(turn)[:, :3, :3], atol=1e-12)


def test_three_hinges_reach_what_a_ball_reaches():
    model, rng = ball_model(), np.random.default_rng(2)
    hinges = single_valued(model)
    assert hinges.model.joint_type == ("floating", *["revolute"] * 7)
    assert len(set(hinges.model.names)) == 8
    np.testing.assert_array_equal(hinges.number, [0, 3, 6, 7])
    q = 0.5 * rng.normal(size=8)
    q[0] = 0
    expected = hinges.model.forward(q)[hinges.number]
    np.testing.assert_allclose(model.forward(hinges.back(q)), expected, atol=1e-12)


def test_retargeting_with_balls():
    model, rng = ball_model(), np.random.default_rng(3)
    q = 0.4 * rng.normal(size=8)
    q[0] = 0
    chosen = np.concatenate([np.flatnonzero(model.labels == p)[:4] for p in range(4)])
    source, target = model.points[chosen], model.pose(q)[chosen]
    found = retarget(model, source, target, part=model.labels[chosen])
    np.testing.assert_allclose(model.pose(found.q, found.T_world_root)[chosen], target, atol=1e-4)
    np.testing.assert_array_equal(found.part, model.labels[chosen])
    assert found.q.shape == (8,)


def test_true_motions_give_the_true_centres_and_tree(figure):
    _, truth, centre, frames, model = figure
    root = choose_root(frames, C, model)
    tree, labels, cost = project_balls(frames, C, model, DeviationConfig(), root)
    assert tree_edit_distance(tree.parent, truth.parent) == 0
    rows = frames.rows(C)
    moved = transform(tree.forward()[:, labels[rows]], frames.points[rows])
    np.testing.assert_allclose(moved, model.moved_points(frames, C), atol=1e-3)
    number = [int(labels[model.labels == p][0]) for p in range(len(PARENT))]
    expected = (transform(truth.poses[C, PARENT.clip(min=0)], centre) - frames.centre) / frames.unit
    np.testing.assert_allclose(tree.centre[number][1:], expected[1:], atol=1e-3)
    assert cost < 0.5  # the gaps between the boxes


def test_the_cost_of_a_ball_is_how_far_its_centre_slips(figure):
    _, _, _, frames, model = figure
    parts = centred(frames, C, model, 0.3)
    pairs = np.arange(1, 6), PARENT[1:]
    exact = fit_balls(parts, *pairs)
    assert parts.deviation(exact.cost).max() < 1e-12
    shifted = model.T.copy()
    shift = np.random.default_rng(0).normal(size=(6, 3))
    shift[C] = 0
    shifted[:, 3, :3, 3] += shift
    loose = fit_balls(centred(frames, C, Relaxed(shifted, model.labels), 0.3), *pairs)
    assert loose.cost[2] <= (shift**2).sum() + 1e-9
    assert loose.cost[2] > 0.1 * (shift**2).sum()
    assert loose.cost[[0, 1, 3, 4]].max() < 1e-9


def test_a_figure_is_fitted_from_its_points(figure, tmp_path):
    pytest.importorskip("torch", reason="needs rearticulate[paper]")
    from rearticulate.pipeline import fit

    sequence, truth, centre, _, _ = figure
    fast = preset("paper-fast")
    config = replace(
        fast,
        canonical_tries=1,
        neural=replace(fast.neural, chamfer_iterations=60, emd_iterations=20, final_iterations=60),
        deviation=replace(fast.deviation, joints="ball"),
    )
    result = fit(sequence, config, seed=0)
    found = {m.key: m.value for m in evaluate(result, truth, sequence)}
    assert found["parts"] == 6
    assert found["tree_edit_distance"] == 0
    assert found["recon_cm"] < 1.0
    assert set(result.model.joint_type[1:]) == {"spherical"}
    c = result.model.canonical
    np.testing.assert_array_equal(result.motion.q[c], 0)
    true_centre = transform(truth.poses[c, PARENT.clip(min=0)], centre)[1:]
    gap = np.linalg.norm(result.model.origin[1:, None] - true_centre[None], axis=-1)
    assert gap.min(axis=1).max() < 0.05
    assert all(joint.determined for joint in result.joints)
    save_result(tmp_path / "out", result, sequence)
    back = load_result(tmp_path / "out")
    np.testing.assert_array_equal(back.motion.q, result.motion.q)
    head = (tmp_path / "out" / "joints.csv").read_text().splitlines()[0]
    assert head.startswith("frame,part_1.x [rad],part_1.y [rad],part_1.z [rad],")
