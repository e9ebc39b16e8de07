"""Tables of points: columns by their names, or in the documented orders, or refused; cut lines never make a point."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clouds import clouds
from rearticulate.errors import InputError, InputWarning
from rearticulate.io import load_scans

POINTS = clouds(1)[0]


def table(path: Path, columns: np.ndarray, head: str = "", sep: str = ",", form: str = "%r") -> Path:
    rows = (sep.join(form % float(v) for v in row) for row in columns)
    path.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def others(n: int) -> np.ndarray:
    return np.random.default_rng(9).random((len(POINTS), n))


@settings(max_examples=40, deadline=None)
@given(
    order=st.permutations(["x", "y", "z", "intensity", "ring"]),
    style=st.sampled_from(["{}", "{} [m]", '"{}"', "Points:{}"]),
    upper=st.booleans(),
    sep=st.sampled_from([",", ";", " ", "\t"]),
    as_comment=st.booleans(),
)
def test_named_columns_are_found_wherever_they_stand(
    order: list[str],
    style: str,
    upper: bool,
    sep: str,
    as_comment: bool,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    values = {**dict(zip("xyz", POINTS.T, strict=True)), **dict(zip(("intensity", "ring"), others(2).T, strict=True))}
    axes = {"x": "0", "y": "1", "z": "2"} if style.startswith("Points") else {name: name for name in order}
    names = [style.format(axes[name]) if name in "xyz" else name for name in order]
    head = sep.join(name.upper() if upper and not name.startswith("P") else name for name in names)
    path = tmp_path_factory.mktemp("t") / "a.csv"
    columns = np.stack([values[name] for name in order], axis=1)
    table(path, columns, ("// " if as_comment else "") + head + "\n", sep)
    np.testing.assert_array_equal(load_scans(path).points[0], POINTS)


def test_words_in_other_columns_do_no_harm(tmp_path: Path) -> None:
    lines = ["label,z,y,x", *(f"door {k}é,{z!r},{y!r},{x!r}" for k, (x, y, z) in enumerate(POINTS.tolist()))]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    np.testing.assert_array_equal(load_scans(tmp_path / "a.csv").points[0], POINTS)


@pytest.mark.parametrize("n", [3, 4, 6, 7, 9, 10])
def test_tables_without_names_begin_with_x_y_z_and_say_what_is_left(n: int, tmp_path: Path) -> None:
    path = table(tmp_path / "a.xyz", np.hstack([POINTS, others(n - 3)]), sep=" ")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        np.testing.assert_array_equal(load_scans(path).points[0], POINTS)
    assert [f"{n} columns" in str(w.message) for w in told] == [True] * (n > 3)


@pytest.mark.parametrize(
    ("head", "n", "complaint"),
    [
        ("", 5, "5 columns without names"),
        ("", 2, "2 columns without names"),
        ("a,b,c\n", 3, "it has no x, y, z; it has a, b, c"),
        ("x,y,x,z\n", 4, "x more than once"),
        ("x,y,z,i\n", 3, "4 columns"),
        ("149\n", 3, "promises 149 points, but 150"),
        ("151\n", 3, "promises 151 points, 150"),
    ],
)
def test_tables_that_are_not_clear_are_refused(head: str, n: int, complaint: str, tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", np.hstack([POINTS, others(3)])[:, :n], head)
    with pytest.raises(InputError, match=complaint):
        load_scans(path)


def test_a_column_that_counts_is_no_coordinate(tmp_path: Path) -> None:
    path = table(tmp_path / "a.xyz", np.hstack([np.arange(150.0)[:, None], POINTS]), sep=" ")
    with pytest.raises(InputError, match="counts the lines"):
        load_scans(path)


def test_a_count_before_the_points_is_read(tmp_path: Path) -> None:
    np.testing.assert_array_equal(load_scans(table(tmp_path / "a.xyz", POINTS, "150\n", " ")).points[0], POINTS)


@settings(max_examples=150, deadline=None)
@given(share=st.floats(0.1, 1), form=st.sampled_from(["%r", "%.6f", "%.8e"]), sep=st.sampled_from([" ", ","]))
def test_a_cut_table_never_makes_a_point(
    share: float, form: str, sep: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = table(tmp_path_factory.mktemp("t") / "a.xyz", POINTS, sep=sep, form=form)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    true = {tuple(float(form % v) for v in p) for p in POINTS.tolist()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        try:
            points = load_scans(path).points[0]
        except InputError:
            return
    assert {tuple(p) for p in points.tolist()} <= true


def test_what_may_be_cut_is_told_and_what_is_whole_is_not(tmp_path: Path) -> None:
    path = table(tmp_path / "a.xyz", POINTS, sep=" ")
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.warns(InputWarning, match="may be cut, dropped: 1 in a.xyz"):
        assert len(load_scans(path).points[0]) == 149
    table(path, POINTS, sep=" ", form="%.6f")
    path.write_bytes(path.read_bytes()[:-1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(load_scans(path).points[0]) == 150
