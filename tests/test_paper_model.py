"""Part poses and the part field: representations, gradients, draws."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs rearticulate[paper]")

import torch

from rearticulate.config import NeuralConfig
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.methods.paper.field import PartField, cosine, draw_parts, fit_labels
from rearticulate.methods.paper.poses import from_matrices, move, rotations, to_matrices


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def motions(shape, seed=0, size=1.0):
    return exp_se3(size * np.random.default_rng(seed).normal(size=(*shape, 6)))


def test_poses_survive_their_representation():
    T = motions((4, 3))
    np.testing.assert_allclose(to_matrices(from_matrices(torch.from_numpy(T))), T[..., :3, :], atol=1e-14)


def test_any_six_numbers_are_a_rotation():
    R = rotations(torch.randn((50, 6), generator=generator(), dtype=torch.float64))
    np.testing.assert_allclose(R @ R.mT, np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(torch.linalg.det(R), 1, atol=1e-12)


def test_gradient_of_the_poses():
    six = torch.randn((3, 9), generator=generator(), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(to_matrices, six)


def test_points_follow_their_part():
    T, rng = motions((4, 3)), np.random.default_rng(0)
    points, labels = rng.normal(size=(20, 3)), rng.integers(0, 3, 20)
    weights = torch.nn.functional.one_hot(torch.from_numpy(labels), 3).double()
    moved = move(torch.from_numpy(T[..., :3, :]), weights, torch.from_numpy(points))
    np.testing.assert_allclose(moved, transform(T[:, labels], points), atol=1e-12)


def test_a_blend_is_between_the_parts():
    T, points = motions((2, 2)), np.random.default_rng(0).normal(size=(5, 3))
    weights = torch.full((5, 2), 0.5, dtype=torch.float64)
    moved = move(torch.from_numpy(T[..., :3, :]), weights, torch.from_numpy(points))
    apart = [transform(T[:, np.full(5, p)], points) for p in range(2)]
    np.testing.assert_allclose(moved, np.mean(apart, axis=0), atol=1e-12)


def test_gradient_of_moved_points():
    T = torch.from_numpy(motions((2, 3))[..., :3, :]).requires_grad_()
    weights = torch.rand((4, 3), generator=generator(), dtype=torch.float64, requires_grad=True)
    points = torch.rand((4, 3), generator=generator(), dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda a, b: move(a, b, points), (T, weights))


def test_draws_have_the_probabilities_of_the_softmax():
    logits = torch.tensor([0.0, 1.0, 2.0]).repeat(20_000, 1)
    for temperature in (1.0, 5.0):
        drawn = draw_parts(logits, temperature, generator())
        np.testing.assert_allclose(drawn.mean(dim=0), logits[0].softmax(dim=0), atol=0.01)
        np.testing.assert_allclose(drawn.sort(dim=1).values[:, -1], 1, atol=1e-6)


def test_the_gradient_of_a_draw_is_that_of_its_softmax():
    logits = torch.randn((6, 4), generator=generator(), dtype=torch.float64, requires_grad=True)
    pull = torch.randn((6, 4), generator=generator(1), dtype=torch.float64)
    draw_parts(logits, 2.0, generator(2)).mul(pull).sum().backward()
    straight = logits.grad.clone()
    noise = -(-torch.rand(logits.shape, generator=generator(2), dtype=logits.dtype).log()).log()
    logits.grad = None
    ((logits + noise) / 2.0).softmax(dim=1).mul(pull).sum().backward()
    np.testing.assert_allclose(straight, logits.grad, atol=1e-14)


def test_a_field_learns_labels():
    points = torch.rand((300, 3), generator=generator()) - 0.5
    labels = (points[:, 0] > 0).long() + 2 * (points[:, 2] > 0.1).long()
    field = PartField(4, 128, generator())
    fit_labels(field, points, labels, NeuralConfig())
    assert (field(points).argmax(dim=1) == labels).float().mean() > 0.97


def test_cosine_goes_from_first_to_last():
    assert [cosine(5.0, 1.0, done) for done in (0.0, 0.5, 1.0)] == pytest.approx([5.0, 3.0, 1.0])


def test_the_global_generator_of_torch_is_left_alone():
    state = torch.get_rng_state()
    PartField(4, 16, generator())
    assert torch.equal(torch.get_rng_state(), state)
