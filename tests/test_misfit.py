"""How badly points land on the other frames: least under the true motion, and what sampling alone leaves."""

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.observe.frames import make_frames
from rearticulate.observe.misfit import frame_residual, point_misfit, sampling_distance


def test_the_true_motion_has_the_least_misfit():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(1200, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True) / [1.0, 1.3, 1.7]
    T = exp_se3(np.array([0.3, -0.2, 0.4, 0.5, 0.1, 0.0]))
    frames = make_frames([ball[:600], transform(T, ball[600:])])
    centred = in_spacings(frames, np.stack([np.eye(4), T])[:, None])
    one = np.zeros(1200, dtype=int)
    best = point_misfit(frames, centred, one).mean()
    for twist in np.eye(6) * [0.1, 0.1, 0.1, 1.0, 1.0, 1.0]:
        off = centred.copy()
        off[1, 0] = exp_se3(twist) @ off[1, 0]
        assert point_misfit(frames, off, one).mean() > best + 0.01


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
