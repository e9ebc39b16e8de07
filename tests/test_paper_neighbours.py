"""Neighbours among points that move are those of a search from scratch."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs rearticulate[paper]")

from rearticulate.methods.paper.neighbours import BoxTree


def brute(points, queries, k):
    d = ((queries[:, None] - points[None]) ** 2).sum(axis=-1)
    return np.sort(d, axis=1)[:, :k]


@pytest.mark.parametrize("n", [1, 2, 5, 12, 13, 100, 1000])
@pytest.mark.parametrize("k", [1, 3])
def test_the_nearest_are_found(n, k):
    rng = np.random.default_rng(n)
    points, queries = rng.normal(size=(2, n, 3)).astype(np.float32)
    found = np.full((n, k), -1)
    d = BoxTree(points).search(queries, found)
    known = min(k, n)
    np.testing.assert_allclose(d[:, :known], brute(points, queries, known), rtol=1e-5)
    assert np.isinf(d[:, known:]).all() and (found[:, known:] == -1).all()
    np.testing.assert_allclose(((points[found[:, :known]] - queries[:, None]) ** 2).sum(-1), d[:, :known], rtol=1e-5)
    assert all(len(set(row)) == known for row in found[:, :known].tolist())


@pytest.mark.parametrize("step", [0.0, 0.01, 10.0])
def test_old_neighbours_and_an_old_tree_do_not_change_the_answer(step):
    rng = np.random.default_rng(0)
    points, queries = rng.normal(size=(2, 500, 3)).astype(np.float32)
    tree, found = BoxTree(points), np.full((500, 3), -1)
    tree.search(queries, found)
    for _ in range(4):
        points = points + step * rng.normal(size=points.shape).astype(np.float32)
        queries = queries + step * rng.normal(size=points.shape).astype(np.float32)
        tree.move(points)
        d = tree.search(queries, found, rng.permutation(500))
        np.testing.assert_allclose(d, brute(points, queries, 3), rtol=1e-4, atol=1e-9)


def test_points_in_one_place():
    found = np.full((4, 2), -1)
    assert (BoxTree(np.ones((40, 3))).search(np.ones((4, 3)), found) == 0).all()
