"""The assignment is optimal, from nothing and from any other assignment."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

pytest.importorskip("torch", reason="needs rearticulate[paper]")

from rearticulate.methods.paper.assignment import Assignment, assign


def clouds(kind, n, rng):
    """Two clouds (n, 3)."""
    x, y = rng.normal(size=(2, n, 3))
    if kind == "clustered":
        centres = 5 * rng.normal(size=(3, 3))
        return centres[rng.integers(0, 3, n)] + 0.1 * x, centres[rng.integers(0, 3, n)] + 0.1 * y
    if kind == "coincident":
        return x, x[rng.permutation(n)] + 1e-7 * y
    if kind == "grid":  # many ties
        return rng.integers(0, 3, (n, 3)).astype(float), rng.integers(0, 3, (n, 3)).astype(float)
    if kind == "one place":
        return np.ones((n, 3)), np.ones((n, 3))
    return x, y


def check(x, y, found):
    n, cost = len(x), cdist(x, y, "sqeuclidean")
    assert sorted(found.column) == list(range(n))
    best = cost[linear_sum_assignment(cost)].sum()
    assert cost[np.arange(n), found.column].sum() == pytest.approx(best, rel=1e-9, abs=1e-9)
    reduced = cost - found.price  # the prices prove it: no point would rather have another partner
    assert (reduced[np.arange(n), found.column] <= reduced.min(axis=1) + 1e-8 * max(1.0, cost.max())).all()


@given(
    kind=st.sampled_from(["random", "clustered", "coincident", "grid", "one place"]),
    n=st.integers(1, 60),
    seed=st.integers(0, 2**32 - 1),
    step=st.sampled_from([0.0, 1e-9, 0.01, 1.0, 100.0]),
)
def test_equal_to_scipy_cold_and_warm(kind, n, seed, step):
    rng = np.random.default_rng(seed)
    x, y = clouds(kind, n, rng)
    cold = assign(x, y)
    check(x, y, cold)
    moved = x + step * rng.normal(size=x.shape)
    check(moved, y, assign(moved, y, cold))


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 40))
def test_any_assignment_may_be_the_last_one(seed, n):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(2, n, 3))
    check(x, y, assign(x, y, Assignment(rng.integers(-1, n, n), 10 * rng.normal(size=n))))


def test_what_it_starts_from_is_left_alone():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 30, 3))
    last = assign(x, y)
    column, price = last.column.copy(), last.price.copy()
    assign(-x, y, last)
    np.testing.assert_array_equal(last.column, column)
    np.testing.assert_array_equal(last.price, price)


def test_as_large_as_in_a_fit():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(600, 3)).astype(np.float32)
    y = (x + 0.05 * rng.normal(size=x.shape)).astype(np.float32)
    check(x, y, assign(x, y))
    assert len(assign(x[:0], y[:0]).column) == 0
