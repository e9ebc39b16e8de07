"""The size of every frame, found from parts that move."""

from __future__ import annotations

import numpy as np
import pytest

from rearticulate.geometry.se3 import to_unit
from rearticulate.observe.frames import make_frames
from rearticulate.observe.scale import frame_scales
from rearticulate.synth import objects
from rearticulate.synth.articulated import record


@pytest.mark.parametrize("factors", [(1.0, 1.0, 1.0, 1.0), (1.0, 0.99, 1.012, 0.951)])
@pytest.mark.parametrize("name", ["cabinet", "arm"])
def test_the_scale_of_each_frame_is_found(name, factors):
    sequence, truth = record(objects.OBJECTS[name](), frames=4, points=3000, noise=5e-4, moving_root=True, seed=2)
    frames = make_frames([k * p for k, p in zip(factors, sequence.points, strict=True)])
    labels = np.concatenate(truth.labels)[frames.order]
    T = truth.poses.copy()
    T[..., :3, 3] *= np.array(factors)[:, None, None]  # rigid as a fit has them
    scales = frame_scales(frames, 0, to_unit(T, frames.unit, frames.centre), labels)
    np.testing.assert_allclose(scales.size, factors, atol=3e-3)
    assert scales.size[0] == 1 and (scales.std < 5e-3).all()
    assert scales.differ.tolist() == [k != 1 for k in factors]
    assert scales.drift == pytest.approx(np.ptp(factors), abs=5e-3)


def test_a_sphere_that_is_sampled_afresh_keeps_its_size():
    """Each point lies inside of the tangent planes of the others: against one plane alone it would shrink."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(2, 1000, 3))
    frames = make_frames(list(points / np.linalg.norm(points, axis=-1, keepdims=True)))
    scales = frame_scales(frames, 0, np.tile(np.eye(4), (2, 1, 1, 1)), np.zeros(2000, dtype=int))
    assert abs(scales.size[1] - 1) < 1.5e-3
