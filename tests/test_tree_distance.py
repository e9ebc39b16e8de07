"""Against the definition: the least ordered edit distance (apted) over all sibling orders of both trees."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from apted import APTED, Config
from apted.helpers import Tree
from hypothesis import assume, given
from hypothesis import strategies as st

from rearticulate.evaluation.tree_distance import tree_edit_distance


class FreeRename(Config):
    def rename(self, node1, node2):
        return 0


@st.composite
def trees(draw, max_nodes=8):
    n = draw(st.integers(1, max_nodes))
    return np.array([-1] + [draw(st.integers(0, j - 1)) for j in range(1, n)])


def shuffled(parent, seed):
    """The same tree with other node numbers."""
    new = np.random.default_rng(seed).permutation(len(parent))
    out = np.empty_like(parent)
    out[new] = np.where(parent >= 0, new[parent], -1)
    return out


def orders(parent, node=0):
    """All drawings of a tree in bracket notation, one for each order of its siblings."""
    below = [orders(parent, int(child)) for child in np.flatnonzero(parent == node)]
    return {
        "{a" + "".join(drawing) + "}"
        for arrangement in itertools.permutations(below)
        for drawing in itertools.product(*arrangement)
    }


@given(trees(7), trees(7))
def test_equals_the_least_ordered_distance(a, b):
    A, B = orders(a), orders(b)
    assume(len(A) * len(B) <= 600)
    expected = min(
        APTED(Tree.from_text(x), Tree.from_text(y), FreeRename()).compute_edit_distance() for x in A for y in B
    )
    assert tree_edit_distance(a, b) == expected


@given(trees(12), st.integers(0, 99))
def test_node_numbers_do_not_matter(a, seed):
    assert tree_edit_distance(a, shuffled(a, seed)) == 0


@given(trees(9), trees(9), trees(9))
def test_is_a_symmetric_distance_of_the_right_parity(a, b, c):
    d = tree_edit_distance(a, b)
    assert d == tree_edit_distance(b, a)
    assert d <= tree_edit_distance(a, c) + tree_edit_distance(c, b)
    assert abs(len(a) - len(b)) <= d <= len(a) + len(b) - 2
    assert (d + len(a) + len(b)) % 2 == 0


@given(trees(10), st.integers(0, 99))
def test_one_more_leaf_costs_one(a, seed):
    more = np.append(a, np.random.default_rng(seed).integers(0, len(a)))
    assert tree_edit_distance(a, more) == 1


@given(trees(10), st.integers(0, 99))
def test_one_node_less_costs_one(a, seed):
    assume(len(a) > 1)
    gone = int(np.random.default_rng(seed).integers(1, len(a)))
    parent = np.where(a == gone, a[gone], a)
    assert tree_edit_distance(a, np.delete(parent - (parent > gone), gone)) == 1


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ([-1], [-1], 0),
        ([-1, 0, 1, 2], [-1, 0, 0, 0], 4),  # a chain and a star share a root and one leaf
        ([-1, 0, 0], [-1, 0, 1], 2),
        ([-1, 0, 0, 1, 1, 2], [-1, 0, 0, 1, 2, 2], 0),  # mirrored
        ([1, -1, 1], [-1, 0, 0], 0),  # the root need not come first
    ],
)
def test_small_trees_by_hand(a, b, expected):
    assert tree_edit_distance(np.array(a), np.array(b)) == expected


def test_large_trees_need_no_enumeration():
    """A hand with wide stars: 10! * 6! orders."""
    a = np.array([-1] + [0] * 10 + [1] * 6)
    b = np.array([-1] + [0] * 9 + [1] * 5 + [2])
    assert tree_edit_distance(a, b) == 3
