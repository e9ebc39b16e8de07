"""The order of frames: whole numbers as people count, times as numbers."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clouds import clouds, refusal
from rearticulate.errors import InputWarning
from rearticulate.io import load_sequence
from rearticulate.io.order import describe_order, in_order, natural_order, ordered_by


def quietly(names: list[str], suffix: str = "") -> list[str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return in_order(names, suffix)


@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=8, unique=True))
def test_natural_order_is_the_order_of_the_numbers(numbers: list[int]) -> None:
    names = [f"scan{n}.ply" for n in sorted(numbers)]
    assert natural_order(f"scan{n}.ply" for n in numbers) == names
    assert in_order([f"scan{n}.ply" for n in numbers], ".ply") == names


@settings(max_examples=1000, deadline=None)
@given(st.integers(1_000_000_000_000_000, 2_000_000_000_000_000), st.integers(0, 2**31))
def test_recordings_named_by_the_clock_are_in_order(start: int, seed: int) -> None:
    """str(time.time()) has up to seven decimals, and fewer where the last are zeros."""
    steps = np.random.default_rng(seed).integers(1, 2_000_000, 10)
    times = [int(t) / 1e6 for t in start + np.cumsum(steps)]
    names = [f"{t}.ply" for t in times]
    shuffled = [names[k] for k in np.random.default_rng(seed).permutation(10)]
    assert quietly(shuffled, ".ply") == names


@pytest.mark.parametrize(
    ("names", "by"),
    [
        (["1711111112.33", "1711111112.5", "1711111113.0"], "time"),
        (["2024-03-22T10-15-03.25_cloud", "2024-03-22T10-15-03.5_cloud", "2024-03-22T10-16-00.125_cloud"], "time"),
        (["1711111112", "1711111112.25", "1711111112.5"], "time"),
        (["1711111112.005000000", "1711111112.330000000"], "time"),
        (["1711111112.5000000", "1711111112.330000000"], "number"),  # nanoseconds without zeros before them
        (["1711111112_5000000", "1711111112_330000000"], "number"),
        (["frame_0.5", "frame_0.9", "frame_0.10"], "number"),  # no clock writes 0.10
        (["frame2", "frame10"], "number"),
        (["f" + "9" * 5000, "f1" + "0" * 5000], "number"),
    ],
)
def test_names_are_ordered_by_time_or_by_number(names: list[str], by: str) -> None:
    assert ordered_by(names) == by
    assert quietly(names[::-1]) == names


def test_a_recording_by_the_clock_loads_in_order_and_says_so(tmp_path: Path) -> None:
    points = clouds(3)
    times = ("1711111112.33", "1711111112.5", "1711111113.0")
    for time, frame in zip(times, points, strict=True):
        np.savetxt(tmp_path / f"{time}.xyz", frame)
    with pytest.warns(InputWarning, match=r"1711111112.33.xyz before .*1711111112.5.xyz"):
        sequence = load_sequence(tmp_path)
    assert sequence.names == tuple(f"{time}.xyz" for time in times)
    for loaded, frame in zip(sequence.points, points, strict=True):
        np.testing.assert_array_equal(loaded, frame)
    assert describe_order(sequence.names).endswith("(by time)")
    np.savez(tmp_path / "a.npz", **dict(zip(times, points, strict=True)))
    with pytest.warns(InputWarning, match="times"):
        np.testing.assert_array_equal(load_sequence(tmp_path / "a.npz").points, points)


def test_one_folder_a_state(tmp_path: Path) -> None:
    points = clouds(3)
    for number, frame in zip((2, 10, 1), points, strict=True):
        (tmp_path / f"state{number}").mkdir()
        np.savetxt(tmp_path / f"state{number}" / "cloud.xyz", frame)
        (tmp_path / f"state{number}" / "camera.json").write_text("{}")
    sequence = load_sequence(tmp_path)
    assert sequence.names == ("state1", "state2", "state10")
    np.testing.assert_array_equal(sequence.points, points[[2, 0, 1]])
    np.testing.assert_array_equal(load_sequence(tmp_path / "*" / "cloud.xyz").points, sequence.points)
    np.savetxt(tmp_path / "state2" / "more.xyz", points[0])
    assert "state2 holds 2 files of points; give each folder exactly one" in refusal(tmp_path)


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
def test_names_do_not_steer_a_terminal(tmp_path: Path) -> None:
    points = clouds(2)
    for name, frame in zip((b"a\x1b[31m0.xyz", b"a\xff1.xyz"), points, strict=True):
        with open(os.path.join(os.fsencode(tmp_path), name), "wb") as file:
            np.savetxt(file, frame)
    sequence = load_sequence(tmp_path)
    assert len(sequence) == 2 and all(name.isprintable() for name in sequence.names)
