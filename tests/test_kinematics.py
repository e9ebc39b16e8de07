"""Forward kinematics by hand, Jacobians against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle import random_model
from rearticulate.geometry.kinematics import forward_kinematics, joint_jacobian, screw_jacobian
from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, log_se3, transform

seeds = st.integers(0, 10_000)


def left_difference(plus, minus, step):
    """Left twist of T per unit of the parameter, from T at +step and -step."""
    return log_se3(plus @ inverse(minus)) / (2 * step)


def test_planar_arm_by_hand():
    parent = np.array([-1, 0, 1])
    twists = np.array([[0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 1, 0, -1.0, 0]])  # about z at x = 0 and x = 1
    T = forward_kinematics(parent, twists, np.array([0, np.pi / 2, np.pi / 2]))
    np.testing.assert_allclose(transform(T[1], np.array([[1.0, 0, 0]])), [[0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(transform(T[2], np.array([[2.0, 0, 0]])), [[-1, 1, 0]], atol=1e-12)


@given(seeds)
def test_zero_is_the_canonical_pose_and_the_root_moves_everything(seed):
    model = random_model(seed)
    np.testing.assert_array_equal(model.forward(np.zeros(model.n_parts)), np.tile(np.eye(4), (model.n_parts, 1, 1)))
    rng = np.random.default_rng(seed)
    q, root = rng.normal(size=model.n_parts), exp_se3(rng.normal(size=6))
    np.testing.assert_allclose(model.forward(q, root), root @ model.forward(q), atol=1e-12)


@given(seeds)
def test_a_batch_of_poses_equals_single_poses(seed):
    model = random_model(seed)
    q = np.random.default_rng(seed).normal(size=(3, model.n_parts))
    np.testing.assert_allclose(model.forward(q), np.stack([model.forward(row) for row in q]), atol=1e-12)


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1.0])
@given(seed=seeds)
def test_joint_jacobian_is_the_derivative(scale, seed):
    model, h = random_model(seed), 1e-6
    q = scale * np.random.default_rng(seed).normal(size=model.n_parts)
    J = joint_jacobian(model.parent, model.twists, model.forward(q))
    for j, e in enumerate(np.eye(model.n_parts)):
        expected = left_difference(model.forward(q + h * e), model.forward(q - h * e), h)
        np.testing.assert_allclose(J[..., j], expected, atol=1e-7)


@given(seeds)
def test_screw_jacobian_is_the_derivative(seed):
    model, h = random_model(seed), 1e-6
    q = np.random.default_rng(seed).normal(size=model.n_parts)
    J = screw_jacobian(model.parent, model.twists, q, model.forward(q))
    for j in range(1, model.n_parts):
        for a, eta in enumerate(np.eye(6)):
            moved = []
            for sign in (1, -1):
                twists = model.twists.copy()
                twists[j] = adjoint(exp_se3(sign * h * eta)) @ twists[j]
                moved.append(forward_kinematics(model.parent, twists, q))
            np.testing.assert_allclose(J[:, :, j, a], left_difference(*moved, h), atol=1e-6)
