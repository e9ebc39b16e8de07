"""The energies against plain loops and other solvers, their gradients against finite differences."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

pytest.importorskip("torch", reason="needs rearticulate[paper]")

import torch

from rearticulate.config import NeuralConfig
from rearticulate.geometry.nearest import farthest_points
from rearticulate.methods.paper.correspondences import Assignments, Chamfer, Flow, kept
from rearticulate.methods.paper.energies import assignment_energy, chamfer_energy, flow_energy
from rearticulate.observe.flow import SceneFlow

CANONICAL = 1


def scene(seed=0, sizes=(40, 30, 50)):
    """Frames of unequal size, as one array with starts, and moved canonical points (F, N, 3) near them."""
    rng = np.random.default_rng(seed)
    start = np.concatenate([[0], np.cumsum(sizes)])
    points = rng.normal(size=(start[-1], 3)).astype(np.float32)
    canonical = points[start[CANONICAL] : start[CANONICAL + 1]]
    x = canonical + np.float32(0.2) * rng.normal(size=(len(sizes), *canonical.shape)).astype(np.float32)
    x[CANONICAL] = canonical
    return points, start, x


def clouds_of(points, start):
    return [points[s:e].astype(np.float64) for s, e in pairwise(start)]


def double(x):
    return torch.tensor(x, dtype=torch.float64, requires_grad=True)


def test_chamfer_is_the_sum_of_both_ways():
    points, start, x = scene()
    found = Chamfer(points, start, CANONICAL)
    for moved in (x, x + np.float32(0.1), x[:, ::-1].copy()):
        moved[CANONICAL] = x[CANONICAL]
        energy = chamfer_energy(torch.from_numpy(moved), torch.from_numpy(points), *found.find(moved))
        distances = [cdist(a, b, "sqeuclidean") for a, b in zip(moved, clouds_of(points, start), strict=True)]
        expected = sum(d.min(axis=0).sum() + d.min(axis=1).sum() for d in distances)
        assert float(energy) == pytest.approx(expected, rel=1e-4)


def test_earth_mover_is_the_best_assignment_of_the_samples():
    points, start, x = scene()
    found = Assignments(points, start, CANONICAL, thinning=3)
    clouds = clouds_of(points, start)
    rows = farthest_points(points[start[CANONICAL] : start[CANONICAL + 1]], 10)

    def best(moved):
        costs = [
            cdist(moved[f, rows], clouds[f][farthest_points(points[start[f] : start[f + 1]], 10)], "sqeuclidean")
            for f in (0, 2)
        ]
        return sum(cost[linear_sum_assignment(cost)].sum() for cost in costs)

    def energy(moved):
        return float(assignment_energy(torch.from_numpy(moved), torch.from_numpy(points), *found.find(moved)))

    assert energy(x) == pytest.approx(best(x), rel=1e-5)
    assert energy(x[:, ::-1].copy()) == pytest.approx(best(x[:, ::-1]), rel=1e-5)


def flow_by_hand(x, flow, config):
    """E_flow point by point."""
    total = 0.0
    for f, pair in enumerate(flow):
        for here, there in zip(x[f], x[f + 1], strict=True):
            distance = np.linalg.norm(pair.anchors - here, axis=1)
            near = np.argsort(distance)[:3]
            weight = 1.0 / distance[near]
            observed = (weight[:, None] * pair.vectors[near]).sum(axis=0) / weight.sum()
            if distance.min() > config.flow_far and distance.min() > np.linalg.norm(observed):
                total += config.flow_still * ((there - here) ** 2).sum()
            else:
                total += ((there - here - observed) ** 2).sum()
    return total


@pytest.mark.parametrize("anchors", [20, 2])
def test_flow_is_interpolated_where_anchors_are_near(anchors):
    _, _, x = scene()
    x = x.astype(np.float64)
    rng = np.random.default_rng(1)
    config = NeuralConfig(flow_far=0.4)
    flow = [SceneFlow(x[f, :anchors] + 0.02, 0.5 * rng.normal(size=(anchors, 3))) for f in range(2)]
    found = Flow(flow, x.shape[1], config)
    observed, weight = found.find(x)
    energy = float(flow_energy(torch.from_numpy(x), observed, weight))
    assert energy == pytest.approx(flow_by_hand(x, flow, config), rel=1e-5)
    assert 0 < (weight < 1).sum() < weight.numel()


def test_a_second_search_is_like_the_first():
    points, start, x = scene()
    rng = np.random.default_rng(1)
    flow = [SceneFlow(x[f], rng.normal(size=x[f].shape)) for f in range(2)]

    def searches():
        return Chamfer(points, start, CANONICAL), Flow(flow, x.shape[1], NeuralConfig())

    moved = x + np.float32(0.3) * rng.normal(size=x.shape).astype(np.float32)
    for used, fresh in zip(searches(), searches(), strict=True):
        used.find(x)
        for a, b in zip(used.find(moved), fresh.find(moved), strict=True):
            np.testing.assert_allclose(a.numpy(), b.numpy(), rtol=1e-5)


def test_answers_are_kept_for_some_calls():
    asked = []

    def find(x):
        asked.append(float(x))
        return torch.tensor(asked[-1]), torch.tensor(asked[-1])

    some = kept(find, 3)
    assert [float(some(np.array(float(i)))[1]) for i in range(7)] == [0, 0, 0, 3, 3, 3, 6]
    assert asked == [0, 3, 6]


def test_on_an_anchor_its_own_flow_is_observed():
    _, _, x = scene()
    pair = SceneFlow(x[0], x[1] - x[0])
    flow, distance = pair.interpolate(x[0])
    np.testing.assert_allclose(flow, pair.vectors, atol=1e-6)
    assert (distance == 0).all()
    observed, _ = Flow([pair], x.shape[1], NeuralConfig()).find(x[:2])
    np.testing.assert_allclose(observed[0], pair.vectors, atol=1e-6)


def test_without_anchors_every_point_is_held_still():
    _, _, x = scene()
    nothing = SceneFlow(np.empty((0, 3)), np.empty((0, 3)))
    assert np.isinf(nothing.interpolate(x[0])[1]).all()
    observed, weight = Flow([nothing] * 2, x.shape[1], NeuralConfig()).find(x)
    assert (observed == 0).all() and (weight == np.float32(1e-2)).all()


def test_gradients():
    points, start, x = scene()
    target = torch.from_numpy(points).double()
    near = Chamfer(points, start, CANONICAL).find(x)
    assigned = Assignments(points, start, CANONICAL, 3).find(x)
    step, weight = torch.rand(2, x.shape[1], 3).double(), torch.rand(2, x.shape[1]).double()
    assert torch.autograd.gradcheck(lambda y: chamfer_energy(y, target, *near), double(x))
    assert torch.autograd.gradcheck(lambda y: assignment_energy(y, target, *assigned), double(x))
    assert torch.autograd.gradcheck(lambda y: flow_energy(y, step, weight), double(x))
