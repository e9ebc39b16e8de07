"""How far points land from the other frames, and what sampling alone leaves."""

import numpy as np
import pytest

from rearticulate.observe.frames import make_frames
from rearticulate.observe.misfit import frame_residual, sampling_distance


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
