"""The tree's normal equations against finite differences, and the step they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oracle import random_model
from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, log_se3
from rearticulate.joints.articulated import (
    MAX_STEP,
    Articulated,
    apply_step,
    gauss_newton_step,
    normalise_twists,
    reduced_system,
)

F, CANONICAL = 4, 1
seeds = st.integers(0, 10_000)


def tree(seed: int) -> Articulated:
    rng = np.random.default_rng(seed)
    model = random_model(seed, max_parts=5)
    while model.n_parts < 3:
        seed += 1
        model = random_model(seed, max_parts=5)
    P = model.n_parts
    q, T_root = rng.normal(size=(F, P)), exp_se3(0.5 * rng.normal(size=(F, 6)))
    q[:, 0] = q[CANONICAL] = 0
    T_root[CANONICAL] = np.eye(4)
    revolute = np.array([kind != "prismatic" for kind in model.joint_type])
    return Articulated(model.parent, model.twists, revolute, q, T_root)


def information(seed: int, P: int):
    M = np.random.default_rng(seed + 1).normal(size=(F, P, 8, 6))
    return np.einsum("fpki,fpkj->fpij", M, M)


def quadratic(model: Articulated, target, H) -> float:
    """Half the squared distance of the part poses to target poses; the canonical frame has no say."""
    e = log_se3(model.forward() @ inverse(target))
    cost = np.einsum("fpi,fpij,fpj->f", e, H, e) / 2
    return float(np.delete(cost, CANONICAL).sum())


def unconstrained_step(model: Articulated, step, moving) -> Articulated:
    """`apply_step` without limits and without the normalisation of the twists."""
    P = model.n_parts
    own = P + 5
    frames = step[: len(moving) * own].reshape(len(moving), own)
    q, T_root, twist = model.q.copy(), model.T_root.copy(), model.twist.copy()
    q[moving, 1:] += frames[:, : P - 1]
    T_root[moving] = exp_se3(frames[:, P - 1 :]) @ T_root[moving]
    eta = step[len(moving) * own :].reshape(P - 1, 6)
    twist[1:] = (adjoint(exp_se3(eta)) @ twist[1:, :, None])[..., 0]
    return replace(model, q=q, T_root=T_root, twist=twist)


@given(seeds)
def test_the_reduced_system_is_the_derivative_of_the_quadratic_model(seed):
    model = tree(seed)
    H = information(seed, model.n_parts)
    target = exp_se3(1e-3 * np.random.default_rng(seed).normal(size=(F, model.n_parts, 6))) @ model.forward()
    g = (H @ log_se3(model.forward() @ inverse(target))[..., None])[..., 0]
    A, b, moving = reduced_system(model, CANONICAL, H, g)
    assert moving == [0, 2, 3]
    np.testing.assert_allclose(A, A.T, atol=1e-9 * np.abs(A).max())
    h = 1e-6
    slope = [
        (quadratic(unconstrained_step(model, s, moving), target, H)
         - quadratic(unconstrained_step(model, -s, moving), target, H)) / (2 * h)
        for s in h * np.eye(len(b))
    ]  # fmt: skip
    np.testing.assert_allclose(b, slope, atol=5e-3 * np.abs(b).max())
    # half the curvature term of a step is what the cost grows by beyond its slope, at the bottom of the valley
    at_rest = model.forward()
    direction = np.random.default_rng(seed + 2).normal(size=len(b))
    grown = quadratic(unconstrained_step(model, 1e-4 * direction, moving), at_rest, H)
    np.testing.assert_allclose(grown, 0.5e-8 * direction @ A @ direction, rtol=2e-2)


def displaced(model: Articulated, seed: int, size: float) -> Articulated:
    """The model with other joint values, root poses and screws."""
    rng = np.random.default_rng(seed + 3)
    moving = [f for f in range(F) if f != CANONICAL]
    n = len(moving) * (model.n_parts + 5) + 6 * (model.n_parts - 1)
    return apply_step(model, size * rng.normal(size=n), moving)


@given(seeds)
def test_one_step_lowers_the_cost_and_keeps_the_model_in_order(seed):
    true = tree(seed)
    model = displaced(true, seed, 0.01)
    H, target = information(seed, model.n_parts), true.forward()
    g = (H @ log_se3(model.forward() @ inverse(target))[..., None])[..., 0]
    better = gauss_newton_step(model, CANONICAL, H, g, damping=1e-4)
    assert quadratic(better, target, H) < 0.05 * quadratic(model, target, H)
    np.testing.assert_array_equal(better.q[CANONICAL], 0)
    np.testing.assert_array_equal(better.T_root[CANONICAL], np.eye(4))
    np.testing.assert_array_equal(better.twist[0], 0)
    np.testing.assert_allclose(better.twist[1:], normalise_twists(better.twist[1:], better.revolute[1:]), atol=1e-9)


def test_a_perfect_model_stays():
    model = tree(3)
    H = information(3, model.n_parts)
    same = gauss_newton_step(model, CANONICAL, H, np.zeros((F, model.n_parts, 6)))
    np.testing.assert_allclose(same.forward(), model.forward(), atol=1e-9)


def test_a_huge_step_is_limited():
    model = tree(4)
    moving = [0, 2, 3]
    n = len(moving) * (model.n_parts + 5) + 6 * (model.n_parts - 1)
    far = apply_step(model, np.full(n, 1e3), moving)
    change = (far.q - model.q)[moving, 1:]
    np.testing.assert_allclose(change, np.broadcast_to(np.where(model.revolute[1:], 0.1, 18.0), change.shape))
    np.testing.assert_allclose(log_se3(far.T_root @ inverse(model.T_root))[moving], np.tile(MAX_STEP, (3, 1)))


@given(seeds)
def test_normalised_twists_are_unit_screws_without_pitch(seed):
    rng = np.random.default_rng(seed)
    twist, revolute = 10 * rng.normal(size=(6, 6)), rng.random(6) < 0.5
    unit = normalise_twists(twist, revolute)
    w, v = unit[:, :3], unit[:, 3:]
    np.testing.assert_allclose(np.linalg.norm(np.where(revolute[:, None], w, v), axis=-1), 1.0)
    np.testing.assert_array_equal(w[~revolute], 0)
    np.testing.assert_allclose(np.einsum("ij,ij->i", w, v), 0.0, atol=1e-9)
    np.testing.assert_allclose(normalise_twists(unit, revolute), unit, atol=1e-12)  # nothing left to do
    # the same axis: direction and, for a turn, every point on it
    before, after = (np.where(revolute[:, None], s[:, :3], s[:, 3:]) for s in (twist, unit))
    np.testing.assert_allclose(np.cross(before, after), 0.0, atol=1e-9)
    on_axis = np.cross(twist[:, :3], twist[:, 3:]) / (twist[:, :3] ** 2).sum(-1, keepdims=True)
    np.testing.assert_allclose((np.cross(w, on_axis) + v)[revolute], 0.0, atol=1e-9)
