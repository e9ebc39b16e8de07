"""Observed flow: near the truth, nearer than the matches it starts from, the same for a moved world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.config import PRESETS
from rearticulate.geometry.se3 import transform
from rearticulate.methods.paper.scene_flow import observed_flow
from rearticulate.observe.frames import make_frames
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import arm

PAPER = PRESETS["paper"]
PLAIN = replace(PAPER, neural=replace(PAPER.neural, refined=False))


def recorded(step_deg, points=1500):
    """Frames of an arm, and the true flow of the points of the first."""
    sequence, truth = record(arm(), frames=2, points=points, step_deg=step_deg, start="middle", seed=4)
    frames = make_frames(sequence.points)
    rows = frames.rows(0)
    motion = in_spacings(frames, truth.poses, 0)[1]
    x = frames.points[rows]
    return frames, transform(motion[truth.labels[0][frames.order[rows]]], x) - x


def errors(frames, exact, config):
    flow = observed_flow(frames, config)[0]
    return np.linalg.norm(flow.interpolate(frames.points[frames.rows(0)])[0] - exact, axis=1)


@pytest.mark.parametrize(("step_deg", "spacings"), [(5, 0.3), (25, 0.5)])
def test_flow_is_near_the_truth_and_nearer_than_its_matches(step_deg, spacings):
    frames, exact = recorded(step_deg)
    refined = errors(frames, exact, PAPER)
    assert np.median(refined) < spacings
    assert refined.mean() < 0.5 * errors(frames, exact, PLAIN).mean()


def test_every_pair_of_frames_has_its_own_flow():
    sequence, _ = record(arm(), frames=3, points=700, step_deg=8, seed=1)
    frames = make_frames(sequence.points)
    for config in (PAPER, PLAIN):
        flow = observed_flow(frames, config)
        assert len(flow) == 2
        for f, pair in enumerate(flow):
            own = frames.points[frames.rows(f)]
            assert np.isin(pair.anchors, own).all()


def test_sparse_frames_are_registered_from_rest():
    frames, exact = recorded(40, points=150)
    assert errors(frames, exact, PAPER).mean() < 0.7 * np.linalg.norm(exact, axis=1).mean()
