"""Minimum cuts against all labels there are."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from rearticulate.parts.cuts import Borders, expand


def value(cost: np.ndarray, labels: np.ndarray, borders: Borders) -> float:
    return float(cost[np.arange(len(labels)), labels].sum()) + borders.between(labels)


def problem(seed: int, n: int = 8, parts: int = 3) -> tuple[np.ndarray, np.ndarray, Borders]:
    """Costs (n, parts), some of them infinite, labels that are possible, borders."""
    rng = np.random.default_rng(seed)
    cost, labels = rng.uniform(0, 5, (n, parts)), rng.integers(0, parts, n)
    cost[rng.random((n, parts)) < 0.15] = np.inf
    cost[np.arange(n), labels] = rng.uniform(0, 5, n)
    i, j = np.triu_indices(n, 1)
    kept = rng.random(len(i)) < 0.4
    return cost, labels, Borders(i[kept], j[kept], rng.uniform(0.1, 2, kept.sum()))


@pytest.mark.parametrize("seed", range(20))
def test_an_expansion_is_the_best_set_to_go(seed: int) -> None:
    cost, labels, borders = problem(seed)
    for part in range(cost.shape[1]):
        choices = [np.where(np.array(go), part, labels) for go in product([False, True], repeat=len(labels))]
        best = min(value(cost, choice, borders) for choice in choices)
        assert value(cost, expand(cost, labels, borders, part), borders) == pytest.approx(best, abs=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_expansions_never_cost_more(seed: int) -> None:
    cost, labels, borders = problem(seed, n=200, parts=4)
    for part in (0, 1, 2, 3, 0, 1, 2, 3):
        new = expand(cost, labels, borders, part)
        assert value(cost, new, borders) <= value(cost, labels, borders) + 0.2
        labels = new


def test_without_borders_every_point_takes_the_cheapest() -> None:
    cost, labels, _ = problem(3, n=50)
    none = Borders(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0))
    for part in range(3):
        labels = expand(cost, labels, none, part)
    assert np.array_equal(labels, cost.argmin(axis=1))


@pytest.mark.parametrize("seed", range(5))
def test_what_borders_grow_by_is_the_difference_of_their_cost(seed: int) -> None:
    _, labels, borders = problem(seed, n=60, parts=4)
    members = np.random.default_rng(seed).choice(60, 15, replace=False)
    after = labels.copy()
    after[members] = 2
    expected = borders.between(after) - borders.between(labels)
    assert borders.grown(labels, members, 2) == pytest.approx(expected, abs=1e-9)
