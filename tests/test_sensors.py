"""Where sensors stood, from files: kept with the points they belong to; refused in one line where they do not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clouds import clouds
from rearticulate.errors import InputError, InputWarning
from rearticulate.io import check_sequence, load_sequence, save_sequence
from rearticulate.io.npz import save_arrays
from rearticulate.records import PointSequence

ORIGINS = np.array([[[0, 0, 5.0], [5, 0, 0]], [[0, 1, 5], [np.nan] * 3], [[np.nan] * 3, [5, 2, 0]]])


def sensors() -> dict[str, np.ndarray]:
    """Of three frames of 150 points: two sensors, then the first alone, then the second alone."""
    both = np.arange(150) % 2
    return {"origins": ORIGINS, "sensor_000": both, "sensor_001": 0 * both, "sensor_002": 0 * both + 1}


@pytest.mark.parametrize("where", ["beside", "within", "folder"])
def test_sensors_stay_with_their_points(tmp_path: Path, where: str) -> None:
    points = clouds()
    points[0, 10] = points[0, 11]  # a double goes
    path = tmp_path / ("scan" if where == "folder" else "scan.npz")
    if where == "folder":
        path.mkdir()
        for f, cloud in enumerate(points):
            np.save(path / f"frame{f}.npy", cloud)
    else:
        save_arrays(path, {"points": points, **(sensors() if where == "within" else {})})
    if where != "within":
        save_arrays(tmp_path / "scan.sensor.npz", sensors())
    with pytest.warns(InputWarning):
        sequence = load_sequence(path, scale=0.1, max_points=120)
    for f, expected in enumerate([0.1 * ORIGINS[0], 0.1 * ORIGINS[1, :1], 0.1 * ORIGINS[2, 1:]]):
        np.testing.assert_allclose(sequence.origins[f], expected)
        took = sensors()[f"sensor_{f:03d}"][sequence.index[f]]
        np.testing.assert_array_equal(sequence.sensor[f], took if f == 0 else 0)
    save_sequence(tmp_path / "again.npz", sequence)
    again = load_sequence(tmp_path / "again.npz")
    for name in ("origins", "sensor"):
        for a, b in zip(getattr(sequence, name), getattr(again, name), strict=True):
            np.testing.assert_array_equal(a, b)


def test_without_them_nothing_is_known(tmp_path: Path) -> None:
    np.savez(tmp_path / "scan.npz", points=clouds())
    sequence = load_sequence(tmp_path / "scan.npz")
    assert sequence.origins == () and sequence.sensor == ()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"origins": ORIGINS[:2]}, "(3, S, 3)"),
        ({"origins": ORIGINS[:, 0]}, "(3, S, 3)"),
        ({"origins": np.where(ORIGINS == 5, np.inf, ORIGINS)}, "finite"),
        ({"sensor_000": np.zeros(149, dtype=int)}, "(150,)"),
        ({"sensor_000": np.full(150, 2)}, "sensor_000"),
        ({"sensor_001": np.ones(150, dtype=int)}, "no origin"),
        ({"sensor_001": np.zeros(150)}, "whole numbers"),
        ({"sensor_003": np.zeros(150, dtype=int)}, "4 frames"),
        ({"origins": None}, "no origins"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, wrong: dict[str, np.ndarray | None], said: str) -> None:
    np.savez(tmp_path / "scan.npz", points=clouds())
    arrays = {name: array for name, array in {**sensors(), **wrong}.items() if array is not None}
    save_arrays(tmp_path / "scan.sensor.npz", arrays)
    line = refusal_of(tmp_path)
    assert said in line and "scan.sensor.npz" in line


def refusal_of(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_sequence(folder / "scan.npz")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_arrays_are_checked_before_a_fit() -> None:
    sequence = PointSequence.from_arrays(clouds(), origins=[[[0, 0, 5.0]]] * 3, sensor=[np.ones(150, dtype=int)] * 3)
    with pytest.raises(InputError, match="sensor of frame 0"):
        check_sequence(sequence)
