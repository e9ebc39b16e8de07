"""What takes the word determined from a joint: each test alone, on a joint that passes all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rearticulate.joints.claims import Claim, doubts, least_range
from rearticulate.observe.scale import Scales
from rearticulate.results import few_states, other_scales

DOOR = Claim(
    frames=6,
    turning=True,
    points=300.0,
    span=np.deg2rad(90),
    value_std=np.deg2rad(0.1),
    axis_std=np.deg2rad(0.2),
    path=0.5,
    motion=0.2,
    misfit=0.002,
    away=0.01,
    size=0.9,
    seen=0.3,
    drift=0.0,
)


def test_a_door_that_swung_is_not_doubted():
    assert doubts(DOOR) == []
    assert doubts(replace(DOOR, points=0.0, motion=None, misfit=None)) == []  # inferred, but known by its neighbours


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": 6.0}, "6 points a frame are too few to tell its pose"),
        ({"span": np.deg2rad(1.2)}, "it moved by 1.2°, up to 3° may be noise"),
        ({"frames": 2, "span": np.deg2rad(5)}, "only two states, any small motion is a joint: it moved by 5°"),
        ({"motion": 0.02, "misfit": 0.008}, "one joint leaves 8 mm of its motion of 20 mm unexplained"),
        ({"seen": 0.002}, "its motion leaves the surface where it is"),
        ({"axis_std": np.deg2rad(12)}, "the direction of its axis is known to ±12° only"),
        ({"away": 4.2, "size": 0.6}, "its axis lies 4.2 m outside of an object of 600 mm"),
        (
            {"path": 0.018, "drift": 0.05, "size": 0.5},
            "it moved by 18 mm, the different scales of the frames explain 25 mm",
        ),
    ],
)
def test_each_doubt_alone_and_in_words(change, words):
    (told,) = doubts(replace(DOOR, **change))
    assert told.startswith(words)


def test_a_slide_has_no_axis_to_lie_outside():
    assert doubts(replace(DOOR, turning=False, span=0.4, value_std=0.001, away=4.2)) == []


@given(st.integers(2, 40), st.floats(1e-6, 1.0))
def test_fewer_frames_ask_for_a_larger_motion(frames, std):
    assert least_range(frames, std) > least_range(frames + 1, std) > 3 * std
    assert least_range(frames, 2 * std) == pytest.approx(2 * least_range(frames, std))


def test_two_states_and_other_scales_are_told():
    assert few_states(3) == () and "two states support few claims" in few_states(2)[0]
    size, std = np.array([1.0, 0.99, 0.992, 0.951]), np.array([0.0, 1e-3, 1e-2, 1e-3])
    (note,) = other_scales(Scales(size, std), 0)
    assert note.startswith("frames 1, 3 are 0.990, 0.951 times as large as frame 0: was each scaled by itself?")
    assert other_scales(Scales(np.array([1.0, 1.003]), np.zeros(2)), 0) == ()
    assert Scales(size, std).drift == pytest.approx(0.049)
