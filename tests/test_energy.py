"""The label-free energy: the true motion has the least misfit, and borders cost what they are long."""

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.observe.energy import (
    PER_BORDER,
    PER_EMPTY,
    PER_JOINT,
    border_length,
    energy,
    frame_residual,
    point_misfit,
    sampling_distance,
)
from rearticulate.observe.frames import make_frames


def grid(n: int = 24) -> np.ndarray:
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])


def test_the_border_of_two_halves_of_a_grid():
    frames = make_frames([grid()])
    right = (frames.points[:, 0] > 0).astype(int)
    assert border_length(frames, np.zeros_like(right)) == 0.0
    # eight neighbours: of the inner points of the two columns along the border three of eight are beyond it
    assert border_length(frames, right) == pytest.approx(2 * 24 * 3 / 8 / 24**2, rel=0.05)


def test_sheets_that_lie_close_together_have_no_border():
    low = grid(12)
    frames = make_frames([np.concatenate([low, low + np.array([0, 0, 1.2])])])
    upper = (frames.points[:, 2] > 0).astype(int)
    frames.normals[:] = [0.0, 0.0, 1.0]
    assert border_length(frames, upper) == 0.0


def test_the_true_motion_has_the_least_energy_and_every_part_has_its_price():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(1200, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True) / [1.0, 1.3, 1.7]
    T = exp_se3(np.array([0.3, -0.2, 0.4, 0.5, 0.1, 0.0]))
    frames = make_frames([ball[:600], transform(T, ball[600:])])
    centred = in_spacings(frames, np.stack([np.eye(4), T])[:, None])
    one = np.zeros(1200, dtype=int)
    best = energy(frames, centred, one)
    assert best == pytest.approx(point_misfit(frames, centred, one)[::2].mean())
    for twist in np.eye(6) * [0.1, 0.1, 0.1, 1.0, 1.0, 1.0]:
        off = centred.copy()
        off[1, 0] = exp_se3(twist) @ off[1, 0]
        assert energy(frames, off, one) > best + 0.01
    two = np.concatenate([centred, centred], axis=1)
    half = (frames.points[:, 0] > 0).astype(int)
    expected = best + PER_JOINT + PER_BORDER * border_length(frames, half)
    assert energy(frames, two, half) == pytest.approx(expected)
    assert energy(frames, two, one) == pytest.approx(best + PER_JOINT + PER_EMPTY)


def test_two_samples_of_one_surface_lie_apart_by_the_sampling():
    rng = np.random.default_rng(3)
    ball = rng.normal(size=(6000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    frames = make_frames([ball[:3000], ball[3000:]])
    still = np.tile(np.eye(4), (2, 1, 1, 1))
    residual = frame_residual(frames, 0, still, np.zeros(6000, dtype=int))
    assert sampling_distance(frames)[1] == pytest.approx(residual[1], rel=0.03)
    still[1, 0, 2, 3] = 3.0
    assert frame_residual(frames, 0, still, np.zeros(6000, dtype=int))[1] > 1.5 * sampling_distance(frames)[1]
