"""Trees fitted to poses, and trees that do without a joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle import in_spacings
from rearticulate.geometry.se3 import exp_se3, inverse, log_se3
from rearticulate.joints.articulated import Articulated, apply_step
from rearticulate.joints.bundle import adjust_to_poses
from rearticulate.joints.project import near_contact
from rearticulate.joints.simplify import fix_joint, simplify
from rearticulate.observe.frames import make_frames
from rearticulate.parts.bodies import labels_of, make_bodies
from rearticulate.synth import objects
from rearticulate.synth.articulated import record
from test_articulated import CANONICAL, F, information, tree

seeds = st.integers(0, 10_000)


def disturbed(model, seed, size):
    """A tree near the given one."""
    rng = np.random.default_rng(seed)
    moving = [f for f in range(F) if f != CANONICAL]
    step = size * rng.normal(size=len(moving) * (model.n_parts + 5) + 6 * (model.n_parts - 1))
    return apply_step(model, step, moving)


def pose_error(model, T):
    return np.abs(model.forward() - T).max()


@pytest.mark.parametrize("seed", range(6))
def test_a_tree_finds_the_poses_that_it_can_reach(seed):
    model = tree(seed)
    T, H = model.forward(), 1e4 * information(seed, model.n_parts)
    start = disturbed(model, seed, 0.02)
    found, misfit = adjust_to_poses(start, CANONICAL, np.arange(model.n_parts), T, H)
    assert pose_error(found, T) < 0.05 * pose_error(start, T)
    assert misfit.max() < 1e-4


def test_a_lost_pose_does_not_bend_the_tree():
    model = tree(3)
    T, H = model.forward(), 1e4 * information(3, model.n_parts)
    wrong = T.copy()
    wrong[3, 1] = exp_se3(np.array([0.0, 0, 0, 50, 30, -40])) @ wrong[3, 1]
    found, misfit = adjust_to_poses(disturbed(model, 3, 0.01), CANONICAL, np.arange(model.n_parts), wrong, H)
    right = np.ones(T.shape[:2], dtype=bool)
    right[3, 1] = False
    assert np.abs(found.forward() - T)[right].max() < 1e-2
    assert misfit[3, 1] == misfit.max() > 100


@given(seeds, st.data())
def test_fixing_a_joint_that_does_not_move_changes_no_pose(seed, data):
    model = tree(seed)
    j = data.draw(st.integers(1, model.n_parts - 1))
    q = model.q.copy()
    q[:, j] = 0
    model = replace(model, q=q)
    smaller, number = fix_joint(model, j, int(model.parent[j]))
    assert smaller.n_parts == model.n_parts - 1 and smaller.parent[0] == -1
    assert all(0 <= p < c for c, p in enumerate(smaller.parent[1:], 1))
    np.testing.assert_allclose(smaller.forward()[:, number], model.forward(), atol=1e-9)


@given(seeds, st.data())
def test_a_part_takes_its_children_to_the_sibling_it_joins(seed, data):
    model = tree(seed)
    pairs = [(a, b) for a in range(1, model.n_parts) for b in range(1, model.n_parts) if a != b]
    siblings = [(a, b) for a, b in pairs if model.parent[a] == model.parent[b]]
    if not siblings:
        return
    j, k = data.draw(st.sampled_from(siblings))
    smaller, number = fix_joint(model, j, k)
    assert number[j] == number[k]
    for c in range(1, model.n_parts):
        if c != j:
            assert smaller.parent[number[c]] == number[model.parent[c]]


@given(seeds, st.data())
def test_joints_fixed_in_any_order_and_direction_end_in_one_part(seed, data):
    model = tree(seed)
    P = model.n_parts
    pairs = [(a, b) for a in range(P) for b in range(P) if a != b]
    related = [(a, b) for a, b in pairs if b == model.parent[a] or a == model.parent[b]]
    related += [(a, b) for a, b in pairs if a and b and model.parent[a] == model.parent[b]]
    now = np.arange(P)
    for a, b in data.draw(st.permutations(related)):
        if now[a] != now[b]:
            smaller, number = fix_joint(model, int(now[a]), int(now[b]))
            assert smaller.n_parts == model.n_parts - 1 and smaller.parent[0] == -1
            assert all(0 <= p < c for c, p in enumerate(smaller.parent[1:], 1))
            assert sorted(set(number)) == list(range(smaller.n_parts))
            model, now = smaller, number[now]
    assert model.n_parts == 1


def test_a_part_cut_in_two_becomes_one_again():
    c = 3
    sequence, truth = record(objects.hinge(), frames=6, points=1200, step_deg=12, seed=0)
    frames = make_frames(sequence.points)
    labels = np.concatenate(truth.labels)[frames.order]
    T = in_spacings(frames, truth.poses, c)
    xi = log_se3(inverse(T[:, 0]) @ T[:, 1])
    f = np.linalg.norm(xi[:, :3], axis=1).argmax()
    hinge = xi[f] / np.linalg.norm(xi[f, :3])
    q, spare = xi[:, :3] @ hinge[:3], np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    model = Articulated(
        parent=np.array([-1, 0, 1]),
        twist=np.stack([np.zeros(6), hinge, spare]),
        revolute=np.ones(3, dtype=bool),
        q=np.stack([0 * q, q, 0 * q], axis=1),
        T_root=T[:, 0],
    )
    np.testing.assert_allclose(model.forward()[:, 1], T[:, 1], atol=1e-6)
    far = np.linalg.norm(frames.points - np.cross(hinge[:3], hinge[3:]), axis=1)
    outer = (labels == 1) & (far > np.median(far[labels == 1]))
    found, bodies, _ = simplify(frames, c, model, make_bodies(frames, model.forward(), np.where(outer, 2, labels)))
    merged = labels_of(bodies, len(labels))
    assert found.parent.tolist() == [-1, 0]
    np.testing.assert_array_equal(merged, labels)


def test_a_hidden_link_starts_with_a_part_of_its_child():
    rng = np.random.default_rng(0)
    z = rng.normal(size=(500, 3)) * 20
    inside = np.arange(500) < 200
    few = near_contact(z, np.zeros(3), inside, 4.0, 0.4)
    many = near_contact(z, np.zeros(3), inside, 1e3, 0.4)
    assert not (few | many)[~inside].any()
    assert few.sum() < many.sum() <= 0.4 * inside.sum()
    assert np.linalg.norm(z[few], axis=1).max(initial=0.0) < 4.0
