"""From free parts to a tree: the spanning tree against all trees, and the choice of the root."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rearticulate.geometry.se3 import exp_se3, inverse
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.evidence import Evidence, free_share
from rearticulate.joints.tree import choose_root, spanning_tree
from rearticulate.observe.frames import make_frames
from rearticulate.observe.fused import fuse
from rearticulate.parts.relaxed import Relaxed


def symmetric(cost):
    return np.tril(cost, -1) + np.tril(cost, -1).T


def tree_from_code(code):
    """The edges of the labelled tree with this Pruefer code (Pruefer 1918)."""
    n = len(code) + 2
    degree = 1 + np.bincount(code, minlength=n)
    edges = []
    for v in code:
        leaf = int(np.flatnonzero(degree == 1)[0])
        edges.append((leaf, v))
        degree[leaf] -= 1
        degree[v] -= 1
    return [*edges, tuple(int(v) for v in np.flatnonzero(degree == 1))]


def cost_of(parent, cost):
    return sum(cost[j, p] for j, p in enumerate(parent) if p >= 0)


@given(st.integers(0, 10_000), st.integers(0, 3), st.booleans())
def test_no_labelled_tree_is_cheaper(seed, root, whole):
    rng = np.random.default_rng(seed)
    cost = symmetric(rng.integers(0, 3, (4, 4)).astype(float) if whole else rng.uniform(0, 5, (4, 4)))
    parent, order = spanning_tree(cost, root)
    trees = [tree_from_code(code) for code in product(range(4), repeat=2)]
    assert len({frozenset(map(frozenset, t)) for t in trees}) == 16  # Cayley: 4^2 trees
    assert cost_of(parent, cost) == pytest.approx(min(sum(cost[e] for e in t) for t in trees))
    assert parent[root] == -1
    assert sorted(order) == [0, 1, 2, 3] and order[0] == root
    place = np.argsort(order)
    assert all(place[parent[j]] < place[j] for j in range(4) if j != root)


def test_zero_costs_are_edges_too():
    parent, order = spanning_tree(np.zeros((4, 4)), 2)
    assert (parent >= 0).sum() == 3 and parent[2] == -1
    assert len(order) == 4
    cost = np.full((4, 4), 5.0)
    cost[0, 1] = cost[1, 0] = cost[1, 2] = cost[2, 1] = cost[2, 3] = cost[3, 2] = 0.0
    np.testing.assert_array_equal(spanning_tree(cost, 0)[0], [-1, 0, 1, 2])


def test_one_part_is_a_tree():
    parent, order = spanning_tree(np.zeros((1, 1)), 0)
    assert parent.tolist() == [-1] and order.tolist() == [0]


def three_parts(first=400, second=300, third=100):
    """Three clouds: `second` swings about a far hinge, `third` slides fast, `first` stays."""
    rng = np.random.default_rng(0)
    sizes = (first, second, third)
    places = ((0.0, 0, 0), (12.0, 0, 0), (0, 12.0, 0))
    rest = np.concatenate([rng.uniform(-4, 4, (n, 3)) + c for n, c in zip(sizes, places, strict=True)])
    frames = make_frames([rest] * 3)
    T = np.tile(np.eye(4), (3, 3, 1, 1))
    T[:, 1] = exp_se3(np.arange(3)[:, None] * np.array([0, 0, 0.3, 0, -2.0, 0]))
    T[:, 2, 0, 3] = 15.0 * np.arange(3)
    return frames, Relaxed(T, np.tile(np.repeat([0, 1, 2], sizes), 3)[frames.order])


def test_the_part_at_rest_is_the_root_however_small():
    assert choose_root(*on_canonical(three_parts())) == 0
    assert choose_root(*on_canonical(three_parts(first=60, second=700))) == 0


def on_canonical(pair):
    frames, model = pair
    return frames, 0, model


def test_of_parts_that_move_alike_the_largest_is_the_root():
    frames, model = three_parts(first=100, second=500, third=300)
    still = Relaxed(np.tile(np.eye(4), (3, 3, 1, 1)), model.labels)
    assert choose_root(frames, 0, still) == 1


def test_where_every_part_moves_the_largest_is_the_root():
    frames, model = three_parts(first=100, second=500, third=300)
    moving = np.tile(np.eye(4), (3, 1, 1, 1))
    moving[:, 0, 0, 3] = [0.0, 9.0, 18.0]
    assert choose_root(frames, 0, model) == 0
    assert choose_root(frames, 0, Relaxed(moving @ model.T, model.labels)) == 1


@pytest.mark.parametrize("shift", [(0, 0, 0), (12, 0, 0), (0, 300.0, 0), (-40.0, 7, 1e4)])
def test_the_root_does_not_depend_on_where_the_origin_lies(shift):
    frames, model = three_parts(first=60, second=700, third=200)
    world = np.eye(4)
    world[:3, 3] = shift
    moved = replace(frames, points=frames.points + world[:3, 3])
    carried = Relaxed(world @ model.T @ inverse(world), model.labels)
    assert choose_root(moved, 0, carried) == choose_root(frames, 0, model) == 0


def test_a_link_moves_as_its_joint_says():
    twist = np.array([[0] * 6, [0, 0, 1.0, 0, -1.0, 0], [0, 0, 0, 0, 1.0, 0]])
    q = np.array([[0, 0, 0], [0, 0.4, 2.0]])
    tree = Articulated(np.array([-1, 0, 1]), twist, np.array([True, True, False]), q, exp_se3(np.ones((2, 6))))
    T = tree.forward()
    for j in (1, 2):
        step = exp_se3(tree.q[:, j, None] * tree.twist[j])
        np.testing.assert_allclose(step, inverse(T[:, tree.parent[j]]) @ T[:, j], atol=1e-12)


@given(st.integers(2, 40), st.integers(0, 3))
def test_a_chain_leaves_the_data_that_it_has_no_parameters_for(F, joints):
    data, parameters = 6 * (F - 1), joints * (4 + F - 1)
    assert free_share(F, joints) == pytest.approx((data - parameters) / data)


def evidence(F, sigma=2.0):
    T = np.tile(np.eye(4), (F, 2, 1, 1))
    frames = make_frames([np.random.default_rng(f).uniform(-1, 1, (20, 3)) for f in range(F)])
    fused = fuse(frames, T, np.arange(len(frames.points)) % 2)
    return Evidence(T, np.zeros((F, 2, 6, 6)), sigma, fused, canonical=0)


def test_chi_squares_are_per_number_observed_in_ten_frames():
    cost = np.array([0.0, 54.0, 108.0])
    for joints in range(4):
        np.testing.assert_allclose(evidence(10).reduced(cost, joints), [0, 0.25, 0.5])


def test_with_few_frames_a_chain_must_fit_better_and_a_long_one_says_nothing():
    cost = np.array([1.0])
    per_number = {F: cost[0] / 4 / (6 * (F - 1)) for F in (2, 4, 30)}
    assert evidence(4).reduced(cost, 2) > evidence(4).reduced(cost, 1) > per_number[4]
    assert evidence(30).reduced(cost, 2) < evidence(30).reduced(cost, 1) < per_number[30]
    assert evidence(4).reduced(cost, 0) == per_number[4]
    assert np.isinf(evidence(4).reduced(cost, 3)) and np.isinf(evidence(2).reduced(cost, 2))
    assert np.isfinite(evidence(2).reduced(cost, 1))
