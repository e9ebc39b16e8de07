"""Joints between two parts from their relative motions: exact motions give exact joints."""

from __future__ import annotations

import numpy as np
import pytest

from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, log_se3
from rearticulate.joints.articulated import normalise_twists
from rearticulate.joints.chains import (
    FORGOTTEN,
    LOST_SHARE,
    fit_chain,
    fit_prismatic,
    fit_revolute,
    fit_series,
    kept,
    relative_motion,
    rest_cost,
    trust,
    weighted_square,
)

B, F, CANONICAL = 4, 9, 3
IDENTITY = np.tile(np.eye(6), (B, F, 1, 1))
POINTS = np.tile(np.diag([3e4] * 3 + [300.0] * 3), (B, F, 1, 1))  # of 300 points, ten spacings away


def screws(rng, k, reach=5.0):
    """(B, k, 6) random unit turns whose axes pass within `reach` of the origin."""
    axis = rng.normal(size=(B, k, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return np.concatenate([axis, np.cross(reach * rng.uniform(-0.5, 0.5, (B, k, 3)), axis)], -1)


def values(rng, k, size):
    q = rng.uniform(-size, size, (B, F, k))
    q[:, CANONICAL] = 0
    return q


def product(twist, q):
    """(B, F, 4, 4) product of the joints' steps."""
    A = np.tile(np.eye(4), (B, F, 1, 1))
    for k in range(twist.shape[1]):
        A = A @ exp_se3(q[..., k, None] * twist[:, None, k])
    return A


def signed(fit, twist):
    """The fit's first joint with the sign of the true one: twist (B, 6), q (B, F)."""
    turn = np.where(fit.revolute[:, 0, None], fit.twist[:, 0, :3], fit.twist[:, 0, 3:])
    true = np.where(fit.revolute[:, 0, None], twist[:, 0, :3], twist[:, 0, 3:])
    sign = np.sign((turn * true).sum(-1))
    return sign[:, None] * fit.twist[:, 0], sign[:, None] * fit.q[..., 0]


def test_an_exact_turn():
    rng = np.random.default_rng(0)
    twist, q = screws(rng, 1), values(rng, 1, 1.5)
    fit = fit_revolute(product(twist, q), IDENTITY, CANONICAL, iterations=30)
    assert fit.cost.max() < 1e-8
    assert fit.revolute.all()
    found_twist, found_q = signed(fit, twist)
    np.testing.assert_allclose(found_twist, twist[:, 0], atol=1e-4)
    np.testing.assert_allclose(found_q, q[..., 0], atol=1e-4)
    np.testing.assert_array_equal(fit.q[:, CANONICAL], 0)


def test_an_exact_slide():
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(B, 1, 3))
    twist = normalise_twists(np.concatenate([0 * axis, axis], -1), np.zeros((B, 1), bool))
    q = values(rng, 1, 8.0)
    fit = fit_prismatic(product(twist, q), IDENTITY, rng.normal(size=(B, 3)), CANONICAL)
    assert fit.cost.max() < 1e-8
    assert not fit.revolute.any()
    found_twist, found_q = signed(fit, twist)
    np.testing.assert_allclose(found_twist, twist[:, 0], atol=1e-6)
    np.testing.assert_allclose(found_q, q[..., 0], atol=1e-5)


def test_two_exact_turns_in_series():
    rng = np.random.default_rng(2)
    twist, q = screws(rng, 2, reach=2.0), values(rng, 2, 0.5)
    fit = fit_series(product(twist, q), POINTS, np.zeros((B, 3)), 2, CANONICAL, starts=8)
    assert fit.cost.max() < 1e-8
    sign = np.sign((fit.twist[..., :3] * twist[..., :3]).sum(-1))
    np.testing.assert_allclose(sign[..., None] * fit.twist, twist, atol=1e-6)
    np.testing.assert_allclose(sign[:, None] * fit.q, q, atol=1e-6)


def test_three_turns_in_series():
    """Fourteen steps from a few blind starts leave little of the cost; most pairs are exact."""
    rng = np.random.default_rng(13)
    A = product(screws(rng, 3, reach=2.0), values(rng, 3, 0.5))
    fit = fit_series(A, POINTS, np.zeros((B, 3)), 3, CANONICAL, starts=8)
    assert fit.twist.shape == (B, 3, 6) and fit.q.shape == (B, F, 3)
    assert (fit.cost < 1e-5 * rest_cost(A, POINTS)).all()
    error = log_se3(A @ inverse(product(fit.twist, fit.q)))
    np.testing.assert_allclose(weighted_square(error, POINTS), fit.cost, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(fit.q[:, CANONICAL], 0)
    np.testing.assert_allclose(np.linalg.norm(fit.twist[..., :3], axis=-1), 1.0)
    np.testing.assert_allclose(np.einsum("bki,bki->bk", fit.twist[..., :3], fit.twist[..., 3:]), 0.0, atol=1e-9)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_chain_of_turns_from_nearby_finds_the_true_axes(k):
    rng = np.random.default_rng(k)
    twist, q = screws(rng, k, reach=2.0), values(rng, k, 0.5)
    turning = np.ones((B, k), bool)
    near = normalise_twists(twist + 0.02 * rng.normal(size=twist.shape), turning)
    fit = fit_chain(product(twist, q), POINTS, near, q + 0.02 * (q != 0), turning, CANONICAL, iterations=40)
    assert fit.cost.max() < 1e-8
    np.testing.assert_allclose(fit.twist, twist, atol=1e-4)
    np.testing.assert_allclose(fit.q, q, atol=1e-4)


@pytest.mark.parametrize("k", [1, 2])
def test_fewer_joints_do_not_explain_more(k):
    """k joints against k + 1 generic ones."""
    rng = np.random.default_rng(12 + k)
    A = product(screws(rng, k + 1, reach=2.0), values(rng, k + 1, 0.5))
    few = fit_revolute(A, POINTS, CANONICAL) if k == 1 else fit_series(A, POINTS, np.zeros((B, 3)), 2, CANONICAL, 8)
    many = fit_series(A, POINTS, np.zeros((B, 3)), k + 1, CANONICAL, 8)
    assert (few.cost > 3e-3 * rest_cost(A, POINTS)).all()
    assert (few.cost > 300 * many.cost).all()


def test_a_slide_does_not_explain_a_turn_nor_a_turn_a_screw():
    rng = np.random.default_rng(20)
    twist, q = screws(rng, 1), values(rng, 1, 1.0)
    assert (fit_prismatic(product(twist, q), IDENTITY, np.zeros((B, 3)), CANONICAL).cost > 0.5).all()
    pitched = twist + np.concatenate([0 * twist[..., :3], 2.0 * twist[..., :3]], -1)
    assert (fit_revolute(product(pitched, q), IDENTITY, CANONICAL).cost > 1.0).all()


def test_rest_costs_nothing_and_any_motion_something():
    rest = np.tile(np.eye(4), (B, F, 1, 1))
    np.testing.assert_allclose(rest_cost(rest, IDENTITY), 0.0, atol=1e-20)
    rest[1, 2, 0, 3] = 3.0
    np.testing.assert_allclose(rest_cost(rest, 2 * IDENTITY), [0, 18, 0, 0], atol=1e-12)


def test_directions_nobody_observed_cost_nothing():
    """Registration knows nothing about shifts along x: a slide along x is as good as rest."""
    rng = np.random.default_rng(30)
    A = np.tile(np.eye(4), (B, F, 1, 1))
    A[..., 0, 3] = rng.normal(size=(B, F))
    W = IDENTITY.copy()
    W[..., 3, 3] = 0
    np.testing.assert_allclose(rest_cost(A, W), 0.0, atol=1e-12)
    assert (rest_cost(A, IDENTITY) > 1).all()
    twist, q = screws(rng, 1), values(rng, 1, 1.0)
    blind = fit_revolute(A @ product(twist, q), W, CANONICAL, iterations=30)
    assert blind.cost.max() < 1e-6
    assert (fit_revolute(A @ product(twist, q), IDENTITY, CANONICAL, iterations=30).cost > 0.5).all()


def test_a_frame_without_information_changes_nothing():
    rng = np.random.default_rng(31)
    twist, q = screws(rng, 1), values(rng, 1, 1.0)
    A, W = product(twist, q), IDENTITY.copy()
    A[:, 6] = exp_se3(rng.normal(size=6))
    W[:, 6] = 0
    fit = fit_revolute(A, W, CANONICAL, iterations=30)
    assert fit.cost.max() < 1e-8
    np.testing.assert_allclose(signed(fit, twist)[0], twist[:, 0], atol=1e-4)


def parts(rng, P=3):
    """T (F, P, 4, 4), identity at the canonical frame, and random information H (F, P, 6, 6)."""
    T = exp_se3(rng.normal(size=(F, P, 6)))
    T[CANONICAL] = np.eye(4)
    M = rng.normal(size=(F, P, 6, 6))
    return T, np.einsum("fpki,fpkj->fpij", M, M) + 0.5 * np.eye(6)


def test_relative_motion_of_two_parts():
    T, H = parts(np.random.default_rng(40))
    A, W = relative_motion(T, H, np.array([1, 2]), np.array([0, 1]), CANONICAL)
    np.testing.assert_allclose(A[0], inverse(T[:, 0]) @ T[:, 1], atol=1e-12)
    np.testing.assert_allclose(A[1], inverse(T[:, 1]) @ T[:, 2], atol=1e-12)
    assert not W[:, CANONICAL].any()
    # both covariances add up, in the coordinates of the part that carries
    Ad = adjoint(inverse(T[:, 0]))
    covariance = np.linalg.inv(H[:, 0]) + np.linalg.inv(H[:, 1])
    expected = np.linalg.inv(Ad @ covariance @ np.swapaxes(Ad, -1, -2))
    moving = np.arange(F) != CANONICAL
    np.testing.assert_allclose(W[0, moving], expected[moving], rtol=1e-2, atol=1e-2)


def test_who_is_lost_says_nothing_about_the_other():
    T, H = parts(np.random.default_rng(41))
    H[:, 2] = 0
    _, W = relative_motion(T, H, np.array([2, 1]), np.array([0, 2]), CANONICAL)
    assert np.abs(W).max() < 1e-4 * np.abs(H).max()


@pytest.mark.parametrize("joints", [1, 2])
def test_frames_in_which_a_part_was_lost_have_no_say(joints: int) -> None:
    """A pose 50 spacings off in one end frame: the screws are those of the others, and the part stays as it was."""
    rng = np.random.default_rng(4)
    twist, q = screws(rng, joints), values(rng, joints, 1.0)
    A = product(twist, q)
    A[:, F - 1, :3, 3] += 50.0
    start, zero = twist + 0.01 * rng.normal(size=twist.shape), q + 0.02 * rng.normal(size=q.shape)
    fit = fit_chain(
        A, POINTS, normalise_twists(start, np.ones((B, joints), bool)), zero, np.ones((B, joints), bool), CANONICAL, 30
    )
    np.testing.assert_array_equal(fit.q[:, F - 1], fit.q[:, F - 2])
    assert np.abs(product(fit.twist, fit.q) - A)[:, : F - 1].max() < 2 * FORGOTTEN * 50


def test_a_fifth_of_the_frames_at_most_may_be_lost() -> None:
    squares = 300 * np.tile([0.0, 900.0, 900.0, 900.0, 1.0, 1.0, 1.0, 1.0, 1.0, 400.0], (1, 1))
    weight = trust(squares, np.tile(np.diag([3e4] * 3 + [110.0] * 3), (1, 10, 1, 1)))
    assert (weight < 1).sum() == int(LOST_SHARE * 10)
    assert (weight[0, [0, 4, 5, 6, 7, 8, 9]] == 1).all()
    assert (trust(0.01 * squares, np.tile(np.diag([3e4] * 3 + [110.0] * 3), (1, 10, 1, 1))) == 1).all()


def test_joint_values_that_are_not_trusted_are_those_of_the_frame_before() -> None:
    q = np.arange(12.0).reshape(1, 6, 2)
    trusted = np.array([[False, False, True, True, False, True]])
    np.testing.assert_array_equal(kept(q, trusted, 3)[0, :, 0], [4, 4, 4, 6, 6, 10])
