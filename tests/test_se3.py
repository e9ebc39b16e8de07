"""Group axioms, and SciPy's matrix exponential as the oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from rearticulate.geometry.se3 import (
    adjoint,
    exp_se3,
    from_unit,
    hat,
    inverse,
    log_se3,
    log_so3,
    rotate,
    to_unit,
    transform,
)

small = st.floats(-3, 3, allow_nan=False, width=32)
twists = arrays(np.float64, 6, elements=small)
angles = st.sampled_from([0.0, 1e-12, 1e-9, 1e-5, 0.99e-4, 1.01e-4, 0.3, 2.0, np.pi - 1e-9, np.pi])


def matrix(twist):
    out = np.zeros((4, 4))
    out[:3, :3], out[:3, 3] = hat(twist[:3]), twist[3:]
    return out


def unit(seed):
    x = np.random.default_rng(seed).normal(size=3)
    return x / np.linalg.norm(x)


@given(twists)
def test_exponential_is_the_matrix_exponential(twist):
    np.testing.assert_allclose(exp_se3(twist), expm(matrix(twist)), atol=1e-12)


@given(angles, st.integers(0, 99))
def test_exponential_near_zero_and_half_a_turn(angle, seed):
    twist = np.concatenate([angle * unit(seed), unit(seed + 100)])
    np.testing.assert_allclose(exp_se3(twist), expm(matrix(twist)), atol=1e-12)


@given(angles, st.integers(0, 99))
def test_logarithm_undoes_the_exponential(angle, seed):
    twist = np.concatenate([angle * unit(seed), unit(seed + 100)])
    T = exp_se3(twist)
    found = log_se3(T)
    np.testing.assert_allclose(exp_se3(found), T, atol=3e-8)
    assert np.linalg.norm(found[:3]) == pytest.approx(angle, abs=1e-7)


@given(st.integers(0, 99))
def test_rotation_logarithm_of_exact_half_turns(seed):
    axis = unit(seed)
    R = 2 * np.outer(axis, axis) - np.eye(3)
    w = log_so3(R)
    assert np.linalg.norm(w) == pytest.approx(np.pi)
    assert abs(w @ axis) == pytest.approx(np.pi)


@given(twists, twists, twists)
def test_group_axioms(a, b, c):
    A, B, C = exp_se3(a), exp_se3(b), exp_se3(c)
    np.testing.assert_allclose((A @ B) @ C, A @ (B @ C), atol=1e-11)
    np.testing.assert_allclose(A @ inverse(A), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(A @ B), inverse(B) @ inverse(A), atol=1e-11)
    np.testing.assert_allclose(exp_se3(-a), inverse(A), atol=1e-12)


@given(twists, twists)
def test_adjoint_carries_twists(a, b):
    T = exp_se3(a)
    np.testing.assert_allclose(T @ exp_se3(b) @ inverse(T), exp_se3(adjoint(T) @ b), atol=1e-9)
    np.testing.assert_allclose(adjoint(inverse(T)), np.linalg.inv(adjoint(T)), atol=1e-10)


@given(arrays(np.float64, (5, 6), elements=small), arrays(np.float64, (5, 3), elements=small))
def test_batches_equal_single_calls(twist, x):
    T = exp_se3(twist)
    np.testing.assert_array_equal(T, np.stack([exp_se3(t) for t in twist]))
    np.testing.assert_allclose(
        transform(T, x), [transform(t, p[None])[0] for t, p in zip(T, x, strict=True)], atol=1e-12
    )
    np.testing.assert_allclose(transform(T, x) - T[:, :3, 3], rotate(T, x), atol=1e-12)
    np.testing.assert_allclose(log_se3(T), np.stack([log_se3(t) for t in T]), atol=1e-12)


def test_pure_slide_and_half_turn_are_not_confused():
    slide = exp_se3(np.array([0, 0, 0, 0.3, 0, 0]))
    turn = exp_se3(np.array([0, 0, np.pi, 0, 0, 0]))
    np.testing.assert_allclose(slide[:3, 3], [0.3, 0, 0])
    np.testing.assert_allclose(turn, np.diag([-1.0, -1, 1, 1]), atol=1e-15)


@given(twists, st.floats(0.01, 100), arrays(np.float64, 3, elements=small))
def test_a_motion_in_another_unit_moves_the_same_points(twist, unit, centre):
    T, x = exp_se3(twist), np.random.default_rng(0).normal(size=(5, 3))
    other = to_unit(T, unit, centre)
    moved = transform(other, (x - centre) / unit)
    np.testing.assert_allclose(unit * moved + centre, transform(T, x), atol=1e-9)
    np.testing.assert_allclose(from_unit(other, unit, centre), T, atol=1e-9)
