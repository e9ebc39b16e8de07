"""What sensors write where they saw nothing goes; sizes, steps and units are measured on what is left."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from clouds import clouds
from rearticulate.cli import app
from rearticulate.errors import InputWarning
from rearticulate.io import load_sequence
from rearticulate.io.measure import extent, grid_step, median_spacing, warn_of_unit
from rearticulate.records import PointSequence


def stored(tmp_path: Path, frames: list[np.ndarray] | np.ndarray) -> Path:
    np.savez(tmp_path / "a.npz", **{f"points_{f:03d}": frame for f, frame in enumerate(frames)})
    return tmp_path / "a.npz"


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (-1.0, -1.0, -1.0)])
def test_missing_depth_goes_to_the_last_point(place: tuple[float, ...], tmp_path: Path) -> None:
    points = clouds()
    frames = [np.concatenate([np.tile(place, (3000, 1)), frame]) for frame in points]
    with pytest.warns(InputWarning, match="at one place.*3000 in points_000, 3000 in points_001"):
        sequence = load_sequence(stored(tmp_path, frames))
    np.testing.assert_array_equal(sequence.points, points)
    np.testing.assert_array_equal(sequence.index[0], np.arange(3000, 3150))


def test_a_single_missing_point_goes_where_other_frames_show_what_it_is(tmp_path: Path) -> None:
    points = clouds()
    single, many = np.zeros((1, 3)), np.zeros((30, 3))
    with pytest.warns(InputWarning, match="30 in points_000, 1 in points_002"):
        frames = [np.concatenate([many, points[0]]), points[1], np.concatenate([points[2], single])]
        np.testing.assert_array_equal(load_sequence(stored(tmp_path, frames)).points, points)


def test_an_object_may_pass_through_the_origin(tmp_path: Path) -> None:
    points = clouds()
    points[1, 7] = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(load_sequence(stored(tmp_path, points)).points, points)


def test_stray_points_change_neither_size_nor_unit() -> None:
    points = clouds(2)
    clean = extent(PointSequence.from_arrays(points))
    strayed = np.concatenate([points, 1000 + clouds(2, 5, seed=1)], axis=1)
    np.testing.assert_array_equal(extent(PointSequence.from_arrays(strayed)), clean)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([1e-4, 1e-3, 0.01, 0.05]), st.booleans())
def test_the_step_of_rounded_coordinates_is_measured(seed: int, step: float, single: bool) -> None:
    points = np.random.default_rng(seed).normal(size=(3000, 3))
    assert grid_step(points).max() < 1e-6
    rounded = np.round(points / step) * step
    if single and step > 1e-4:  # of 0.1 mm a few metres away float32 keeps too little
        rounded = rounded.astype(np.float32).astype(np.float64)
    np.testing.assert_allclose(grid_step(rounded), step, rtol=0.02)


def test_float32_far_from_the_origin_is_named_with_step_and_offset(tmp_path: Path) -> None:
    points = clouds(2, 2000)
    with pytest.warns(InputWarning, match=r"steps of 0.5 m, .*subtract an offset such as \(5e\+06"):
        sequence = load_sequence(stored(tmp_path, (points + 5e6).astype(np.float32)))
    assert grid_step(sequence.points[0]).tolist() == [0.5] * 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_sequence(stored(tmp_path, points.astype(np.float32)))
        load_sequence(stored(tmp_path, np.round(points, 3)))
    assert median_spacing(sequence) > 0


def test_a_cabinet_of_kilometres_is_told() -> None:
    with pytest.warns(InputWarning, match="millimetres: fit with --scale 0.001"):
        warn_of_unit(PointSequence.from_arrays(clouds(2) * 300))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_unit(PointSequence.from_arrays(clouds(2)))


def test_info_names_order_counts_and_step(tmp_path: Path) -> None:
    frames = np.round(clouds(2, 2000), 3)
    np.savez(tmp_path / "a.npz", frame_2=frames[0], frame_10=frames[1])
    told = CliRunner().invoke(app, ["info", str(tmp_path / "a.npz")]).stdout
    assert "frame_2, frame_10 (by number)" in told
    assert "1 mm" in told
    facts = json.loads(CliRunner().invoke(app, ["info", str(tmp_path / "a.npz"), "--json"]).stdout)
    assert facts["names"] == ["frame_2", "frame_10"]
    np.testing.assert_allclose(facts["step"], 0.001, rtol=0.02)
