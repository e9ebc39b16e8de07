"""Flow from features, made consistent: exact for rigid pieces, better than the features alone, the same everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.fit.flow import SceneFlow
from rearticulate.fit.frames import make_frames
from rearticulate.fit.guided import guided_flow, matched_flow, smooth
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.network.correspond import sequence_features
from rearticulate.network.inference import load_network
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import arm

TURN = exp_se3(np.array([0.2, -0.1, 0.3, 3.0, 1.0, -2.0]))


def grid(n):
    """Points on a square of n x n spacings."""
    return np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], axis=-1).reshape(-1, 3).astype(float)


def test_smoothing_keeps_a_rigid_motion_and_drops_outliers():
    x = grid(20)
    exact = transform(TURN, x) - x
    np.testing.assert_allclose(smooth(SceneFlow(x, exact)).vectors, exact, atol=1e-4)
    rng = np.random.default_rng(0)
    wrong = rng.random(len(x)) < 0.15
    noisy = exact + 20 * wrong[:, None] * rng.normal(size=x.shape)
    error = np.linalg.norm(smooth(SceneFlow(x, noisy)).vectors - exact, axis=1)
    assert np.quantile(error, 0.95) < 0.5


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_matches_stay_as_they_are(count):
    flow = SceneFlow(np.eye(3)[:count], np.ones((count, 3)))
    assert smooth(flow) is flow


def fourier(x):
    """64 features whose scores fall with the distance of two points (Rahimi and Recht 2007)."""
    phase = x @ np.random.default_rng(5).normal(size=(3, 32)) / 6.0
    return 4.0 * np.concatenate([np.cos(phase), np.sin(phase)], axis=1)


def test_vague_features_are_enough_for_a_rigid_motion():
    """Features that say where a point is to some spacings."""
    rng = np.random.default_rng(1)
    a, b = grid(30), grid(30)[rng.permutation(900)] + np.array([0.3, 0.4, 0.0])
    features = tuple(fourier(x + 1.5 * rng.normal(size=x.shape)) for x in (a, b))
    b = transform(TURN, b)
    exact = transform(TURN, a) - a

    def error(flow):
        return np.median(np.linalg.norm(flow.interpolate(a)[0] - exact, axis=1))

    assert error(matched_flow(a, b, features, ratio=1.0)) > 1.0
    assert error(guided_flow(a, b, features)) < 0.5


def recorded():
    sequence, truth = record(arm(), frames=2, points=1500, step_deg=12, start="middle", seed=4)
    frames = make_frames(sequence.points)
    a, b = (frames.points[frames.rows(f)] for f in range(2))
    motion = in_spacings(frames, truth.poses, 0)[1]
    return a, b, transform(motion[truth.labels[0][frames.order[frames.rows(0)]]], a) - a


def test_guidance_lowers_the_error_of_the_network_on_an_arm():
    a, b, exact = recorded()
    features = tuple(sequence_features(load_network(), [a, b]))

    def error(flow):
        return np.linalg.norm(flow.interpolate(a)[0] - exact, axis=1).mean()

    assert error(guided_flow(a, b, features)) < 0.6 * error(matched_flow(a, b, features, ratio=0.9))


def test_flow_turns_with_the_world():
    a, b, _ = recorded()
    features = tuple(sequence_features(load_network(), [a, b]))
    flow = guided_flow(a, b, features)
    moved = guided_flow(transform(TURN, a), transform(TURN, b), features)
    np.testing.assert_allclose(moved.vectors, flow.vectors @ TURN[:3, :3].T, atol=1e-6)
