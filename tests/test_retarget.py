"""Poses are found again from the points they moved, whatever the units, the place and the tree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from oracle import perfect_fit, random_model, read_pair
from rearticulate.errors import InputError
from rearticulate.geometry.kabsch import kabsch
from rearticulate.geometry.kinematics import forward_kinematics
from rearticulate.geometry.se3 import exp_se3, inverse, log_se3, transform
from rearticulate.retargeting.least_squares import PoseProblem, moved, point_jacobian
from rearticulate.retargeting.retarget import best_joint_value, retarget

seeds = st.integers(0, 10_000)


def some_points(model, count, seed):
    """Rows of `count` canonical points of every part."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.choice(np.flatnonzero(model.labels == p), count, False) for p in range(model.n_parts)])


def random_pose(model, seed, turn=0.5):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, model.n_parts)
    q[0] = 0
    return q, exp_se3(turn * rng.normal(size=6))


def arm(lengths=(1.0, 1.0)):
    """A planar chain of revolute joints about z along x, points spread along each link."""
    P = len(lengths) + 1
    starts = np.concatenate([[-1.0, 0.0], np.cumsum(lengths)])[:P]
    t = np.linspace(0.05, 0.95, 20)
    model = random_model(0)
    links = [
        np.stack([s + t * (1 if p == 0 else lengths[p - 1]), 0.1 * np.sin(9 * t), 0.1 * np.cos(7 * t)], 1)
        for p, s in enumerate(starts)
    ]
    return replace(
        model,
        parent=np.arange(-1, P - 1),
        joint_type=("floating", *["revolute"] * (P - 1)),
        axis=np.array([[0, 0, 0]] + [[0, 0, 1.0]] * (P - 1)),
        origin=np.stack([[s, 0, 0] for s in starts]),
        limits=np.tile([-0.6, 0.6], (P, 1)),
        names=tuple(f"part_{p}" for p in range(P)),
        points=np.concatenate(links),
        labels=np.repeat(np.arange(P), len(t)),
    )


@given(seeds)
def test_every_point_comes_back_from_four_points_a_part(seed):
    model = random_model(seed)
    q, root = random_pose(model, seed)
    rows = some_points(model, 4, seed)
    target = model.pose(q, root)
    found = retarget(model, model.points[rows], target[rows])
    size = np.linalg.norm(np.ptp(model.points, axis=0))
    assert np.linalg.norm(model.pose(found.q, found.T_world_root) - target, axis=1).max() < 2e-3 * size
    assert found.residual.max() < 2e-3 * size
    assert found.converged
    assert found.q[0] == 0


@given(seeds)
def test_one_part_is_a_rigid_alignment(seed):
    rng = np.random.default_rng(seed)
    x, T = rng.normal(size=(6, 3)), exp_se3(rng.normal(size=6))
    np.testing.assert_allclose(kabsch(x, transform(T, x)), T, atol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1000.0])
@given(seed=seeds)
def test_units_do_not_matter(scale, seed):
    model = random_model(seed)
    slides = np.array([kind == "prismatic" for kind in model.joint_type])
    big = replace(
        model,
        points=scale * model.points,
        origin=scale * model.origin,
        limits=np.where(slides, scale, 1.0)[:, None] * model.limits,
    )
    q, root = random_pose(model, seed, turn=0.1)
    rows = some_points(model, 2, seed)
    target = model.pose(q, root)[rows] + 0.01 * np.random.default_rng(seed).normal(size=(len(rows), 3))
    a = retarget(model, model.points[rows], target)
    b = retarget(big, big.points[rows], scale * target)
    np.testing.assert_allclose(b.q / np.where(slides, scale, 1.0), a.q, atol=1e-5)
    np.testing.assert_allclose(b.T_world_root[:3, :3], a.T_world_root[:3, :3], atol=1e-5)
    np.testing.assert_allclose(b.residual, scale * a.residual, atol=1e-5 * scale)


def test_where_the_world_begins_does_not_matter():
    model = arm()
    shift = np.array([50.0, -20, 5])
    away = replace(model, points=model.points + shift, origin=model.origin + shift)
    rows = some_points(model, 2, 0)
    target = model.pose(np.array([0, 0.7, -0.4]), exp_se3(np.array([0.1, 0, 0.2, 0.1, 0, 0])))[rows]
    a = retarget(model, model.points[rows], target)
    b = retarget(away, away.points[rows], target + shift)
    np.testing.assert_allclose(a.q, b.q, atol=1e-6)
    np.testing.assert_allclose(b.T_world_root, translation(shift) @ a.T_world_root @ translation(-shift), atol=1e-5)


def translation(t):
    T = np.eye(4)
    T[:3, 3] = t
    return T


def test_joints_that_nothing_constrains_stay_put():
    model = replace(arm(lengths=(1.0, 1.0, 1.0)), limits=np.tile([0.2, 1.0], (4, 1)))
    rows = np.flatnonzero(model.labels <= 1)[::5]
    target = model.pose(np.array([0, 0.5, 0, 0]))
    found = retarget(model, model.points[rows], target[rows])
    np.testing.assert_array_equal(found.q[2:], 0)
    assert found.q[1] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_from_a_present_posture_only_what_is_dragged_moves(seed):
    model = random_model(seed)
    q, root = random_pose(model, seed, turn=0.3)
    leaf = int(np.setdiff1d(np.arange(model.n_parts), model.parent)[-1])
    rows = np.flatnonzero(model.labels == leaf)[:3]
    here = transform(model.forward(q, root)[model.labels[rows]], model.points[rows])
    part = model.labels[rows]
    same = retarget(model, model.points[rows], here, part=part, free_root=False, q=q, T_world_root=root)
    np.testing.assert_allclose(same.q[1:], q[1:], atol=1e-4)
    np.testing.assert_allclose(same.T_world_root, root, atol=1e-9)
    above = {leaf}
    for j in range(model.n_parts - 1, 0, -1):
        if j in above:
            above.add(int(model.parent[j]))
    others = [j for j in range(1, model.n_parts) if j not in above]
    there = here + 0.01 * np.ptp(model.points)
    moved_on = retarget(model, model.points[rows], there, part=part, free_root=False, q=q, T_world_root=root)
    np.testing.assert_array_equal(moved_on.q[others], q[others])


def test_a_wrong_pair_does_no_harm():
    model = arm()
    q = np.array([0, 0.9, -0.5])
    rows = some_points(model, 5, 1)
    target = model.pose(q)[rows]
    target[7] += [0.5, -1.0, 0.7]
    found = retarget(model, model.points[rows], target)
    np.testing.assert_allclose(found.q, q, atol=5e-3)
    assert found.residual.argmax() == 7
    assert np.delete(found.residual, 7).max() < 0.01


def test_a_wrong_label_at_a_seam_is_put_right():
    model = arm(lengths=(1.0, 1.0, 1.0))
    q = np.array([0, 0.8, -0.9, 1.1])
    rows = np.array([5, 12, 22, 33, 39, 48, 55, 68, 75])  # 39: the last point of part 1, at the seam to part 2
    target = model.pose(q)[rows]
    labels = model.labels.copy()
    labels[39] = 2
    found = retarget(replace(model, labels=labels), model.points[rows], target)
    np.testing.assert_array_equal(found.part, model.labels[rows])
    np.testing.assert_allclose(found.q, q, atol=5e-3)


def test_given_parts_are_kept():
    model = arm()
    rows = some_points(model, 3, 0)
    part = model.labels[rows]
    part[0] = 2
    found = retarget(model, model.points[rows], model.pose(np.array([0, 0.5, 0.5]))[rows], part=part)
    np.testing.assert_array_equal(found.part, part)


def test_a_fixed_root_stays():
    model = arm()
    rows = some_points(model, 3, 0)
    target = model.pose(np.array([0, 0.3, 0.2]), exp_se3(np.array([0, 0, 0.2, 0.1, 0, 0])))[rows]
    found = retarget(model, model.points[rows], target, free_root=False)
    np.testing.assert_array_equal(found.T_world_root, np.eye(4))


def test_one_click_moves_an_arm_rather_than_its_root():
    model = arm()
    row = np.flatnonzero(model.labels == 2)[-1:]
    target = model.pose(np.array([0, 0.4, 0.3]))[row]
    found = retarget(model, model.points[row], target)
    assert found.residual[0] < 0.01
    assert np.linalg.norm(log_se3(found.T_world_root)) < 0.05


def test_turns_come_back_near_the_observed_range():
    model = replace(arm(), limits=np.tile([2.0, 4.0], (3, 1)))
    rows = some_points(model, 4, 0)
    q = np.array([0, 3.8, 2.5])
    found = retarget(model, model.points[rows], model.pose(q)[rows])
    np.testing.assert_allclose(found.q, q, atol=1e-3)


@given(seeds)
def test_the_result_is_reproducible_and_inputs_are_left_alone(seed):
    model = random_model(seed)
    rows = some_points(model, 1, seed)
    source, target = model.points[rows], model.pose(*random_pose(model, seed))[rows]
    before = source.copy(), target.copy()
    a, b = retarget(model, source, target, seed=3), retarget(model, source, target, seed=3)
    np.testing.assert_array_equal(a.q, b.q)
    np.testing.assert_array_equal(source, before[0])
    np.testing.assert_array_equal(target, before[1])


@given(seeds)
def test_the_point_jacobian_is_the_derivative(seed):
    model, h = random_model(seed), 1e-6
    assume(model.n_parts > 1)
    rows = some_points(model, 2, seed)
    part = model.labels[rows][None]
    problem = PoseProblem(
        parent=model.parent,
        twists=model.twists,
        limits=model.limits,
        rest=np.zeros(model.n_parts),
        held=np.zeros(model.n_parts),
        span=np.ones(model.n_parts),
        path=np.eye(model.n_parts, dtype=bool),
        source=model.points[rows],
        target=model.points[rows],
        free_root=True,
    )
    q, root = random_pose(model, seed)

    def at(step):
        T = forward_kinematics(model.parent, model.twists, q + step[:-6], exp_se3(step[-6:]) @ root)
        return moved(problem, T[None], part)[0]

    J = point_jacobian(problem, model.forward(q, root)[None], part)[0]
    for i, e in enumerate(np.eye(J.shape[-1])):
        np.testing.assert_allclose(J[..., i], (at(h * e) - at(-h * e)) / (2 * h), atol=1e-6)


def test_each_chain_step_is_the_best_joint_value():
    rng = np.random.default_rng(0)
    source, noise = rng.normal(size=(5, 3)), 0.3 * rng.normal(size=(5, 3))
    for twist in (np.array([0, 0, 1.0, 0.3, -0.2, 0]), np.array([0, 0, 0, 0, 1.0, 0])):
        target = transform(exp_se3(0.8 * twist), source) + noise
        best = best_joint_value(twist, source, target[None], np.ones((1, 5), dtype=bool))[0]
        values = best + np.array([-1e-3, 0, 1e-3])
        costs = [((transform(exp_se3(v * twist), source) - target) ** 2).sum() for v in values]
        assert costs[1] < min(costs[0], costs[2])


@pytest.mark.parametrize(
    ("source", "target", "part", "says"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), None, "at least one row"),
        (np.zeros((2, 2)), np.zeros((2, 3)), None, r"\(2, 2\)"),
        (np.zeros(3), np.zeros((1, 3)), None, "source"),
        (np.zeros((2, 3)), np.zeros((3, 3)), None, "2 source points but 3 target points"),
        (np.zeros((2, 3)), np.array([[0, 0, 0], [0, np.nan, 0]]), None, "target point 1"),
        (np.array([[np.inf, 0, 0]]), np.zeros((1, 3)), None, "source point 0"),
        (np.zeros((2, 3)), np.zeros((2, 3)), [0, 9], "unknown part 9: the model has parts 0 to 2"),
        (np.zeros((2, 3)), np.zeros((2, 3)), [0, -1], "unknown part -1"),
        (np.zeros((2, 3)), np.zeros((2, 3)), [0], "one part number"),
        (np.zeros((2, 3)), np.zeros((2, 3)), [0.0, 1.0], "float64"),
    ],
)
def test_unusable_input_is_named_in_one_line(source, target, part, says):
    with pytest.raises(InputError, match=says) as caught:
        retarget(arm(), source, target, part=part)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["roboart/allegro", "roboart/panda", "roboart/atlas", "roboart/laikago"])
def test_novel_poses_of_true_models_are_found_from_one_click_a_part(data_folder, name):
    sequence, truth = read_pair(data_folder / f"{name}.npz")
    model = perfect_fit(sequence, truth, 5).model
    rows = np.array([np.flatnonzero(model.labels == p)[10] for p in range(model.n_parts)])
    for pose in truth.novel @ inverse(truth.poses[5]):
        target = transform(pose[model.labels], model.points)
        found = retarget(model, model.points[rows], target[rows])
        error = np.linalg.norm(model.pose(found.q, found.T_world_root) - target, axis=1)
        assert error.mean() < 1e-3
