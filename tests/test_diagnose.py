"""Diagnostics of a joint, given the true model: a hinge is sure, a rod that spins about its own axis is not."""

from __future__ import annotations

import numpy as np
import pytest

from rearticulate.config import FitConfig
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.diagnose import diagnose
from rearticulate.observe.frames import make_frames
from rearticulate.synth import objects
from rearticulate.synth.articulated import record

F = 4


def diagnosed(thing, q, points=1200):
    """Frames, diagnostics and joint origins (metres) of the true tree of a recording with joint values q (F, P)."""
    sequence, truth = record(thing, q=q, points=points, seed=3)
    frames = make_frames(sequence.points)
    w, v = thing.twists[:, :3], thing.twists[:, 3:]
    v = np.where(thing.revolute[:, None], (v + np.cross(w, frames.centre)) / frames.unit, v)
    scale, root = np.where(thing.revolute, 1.0, frames.unit), np.tile(np.eye(4), (F, 1, 1))
    tree = Articulated(thing.parent, np.concatenate([w, v], 1), thing.revolute | (thing.parent < 0), q / scale, root)
    labels = np.concatenate(truth.labels)[frames.order]
    joints, origins = diagnose(frames, 0, tree, labels, FitConfig().slide_margin)
    return frames, joints, origins * frames.unit + frames.centre


def sweep(step):
    return step * np.arange(F)[:, None] * np.array([0.0, 1.0])


def test_a_hinge_is_determined():
    frames, joints, origins = diagnosed(objects.hinge(), sweep(0.3))
    hinge = joints[1]
    assert hinge.determined and not hinge.note
    assert hinge.observed_range == pytest.approx(0.9)
    assert 0 < hinge.axis_std < np.deg2rad(3)
    assert 0 < hinge.origin_std < frames.unit
    assert hinge.residual < frames.unit
    assert hinge.runner_up == "prismatic" and hinge.runner_up_margin > 100
    # the axis is the y axis; the joint's origin lies on it, where the two boxes meet
    np.testing.assert_allclose(origins[1, [0, 2]], 0.0, atol=1e-9)
    assert abs(origins[1, 1]) < 0.15


def test_a_slide_is_determined_and_its_range_is_in_metres():
    _, joints, _ = diagnosed(objects.slider(), sweep(0.1))
    assert joints[1].determined
    assert joints[1].observed_range == pytest.approx(0.3)
    # on a straight way the best hinge is far outside: no rival
    assert joints[1].runner_up == "revolute" and joints[1].runner_up_margin == np.inf
    assert joints[1].origin_std is None  # a slide has no position


@pytest.mark.parametrize("step", [0.1, 0.3])
def test_a_spinning_rod_is_not_determined(step):
    _, joints, _ = diagnosed(objects.spinning_rod(), sweep(step))
    assert not joints[1].determined
    assert "surface" in joints[1].note


def test_a_joint_that_never_moved_is_not_determined():
    _, joints, _ = diagnosed(objects.hinge(), sweep(0.0))
    assert not joints[1].determined
