"""Tables of points as text: .xyz, .txt, .csv; blanks, commas or semicolons between; # and // begin comments.

A header line, or a comment with as many names right before the numbers, says by x, y and z which columns they are: in
any order and case, also quoted, with a unit ("X [m]") or as Points:0, Points:1, Points:2. Without one, x y z come first
and the table has 3, 4, 6, 7, 9 or 10 columns: nothing more, an intensity, a normal or a colour, or all of these. A line
with a single whole number before the numbers is their count. Every line has the same number of columns. A file that is
cut at the end of a line cannot be told from a whole one.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.io.budget import check_promise
from rearticulate.io.rows import Note, read_lines, where_xyz

COLUMNS = (3, 4, 6, 7, 9, 10)  # of a table without names: x y z, then intensity, normal, colour
_LONGEST = 65_536  # characters of a line
_XYZ = {"points:0": "x", "points:1": "y", "points:2": "z"}


def first_three(n_columns: int, note: Note, n: int) -> None:
    """Tell that only three of the columns of n points are taken; a ValueError where these may not be x y z."""
    if n_columns not in COLUMNS:
        known = ", ".join(map(str, COLUMNS))
        raise ValueError(f"{n_columns} columns without names; x y z come first in tables of {known} columns only")
    if n_columns > 3:
        note(f"points with {n_columns} columns, of which the first three are taken as x y z", n)


@dataclass(frozen=True)
class _Start:
    """How a table begins: lines before the numbers, names of its columns (none: ()), how many columns, how many points
    it promises (nothing: None), what stands between the columns."""

    skip: int
    names: tuple[str, ...]
    n_columns: int
    n: int | None
    delimiter: str | None


def read_text(path: Path, note: Note) -> NDArray[Any]:
    """(N, 3) points of a table (see the module). Raises ValueError where it is none or its columns are not clear."""
    start = _begin(path)
    if start.n_columns == 0:
        return np.zeros((0, 3))
    xyz = where_xyz(start.names) if start.names else (0, 1, 2)
    if start.n_columns not in COLUMNS and not start.names:
        first_three(start.n_columns, note, 0)
    layout: dict[str, Any] = {"comments": "#", "quotechar": '"', "encoding": "utf-8-sig", "delimiter": start.delimiter}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*input contained no data")
        points = read_lines(path, start.skip, start.n_columns, xyz, note, **layout)
    if start.n is not None:
        check_promise(start.n, len(points))
    if not start.names:
        _check_no_counter(points, start.n_columns)
        first_three(start.n_columns, note, len(points))
    return points


def _begin(path: Path) -> _Start:
    comment, skip = "", 0
    with open(path, encoding="utf-8-sig") as file:
        lines = iter(lambda: file.readline(_LONGEST), "")
        for skip, line in enumerate(lines):  # noqa: B007
            text = line.strip()
            if len(line) == _LONGEST:
                raise ValueError("a line without an end")
            if text and not text.startswith(("#", "//")):
                break
            comment = text.lstrip("#/") or comment
        else:
            return _Start(skip, (), 0, None, None)
        following = next((after for after in islice(lines, 1_000) if after.strip()), "")
    delimiter = next((mark for mark in ";," if mark in line), None)
    cells = _cells(line, delimiter)
    if not _is_number(cells[0]):
        return _Start(skip + 1, tuple(map(_axis, cells)), len(cells), None, delimiter)
    if len(cells) == 1 and cells[0].isdecimal():
        delimiter = next((mark for mark in ";," if mark in following), None)
        return _Start(skip + 1, (), len(_cells(following, delimiter)), int(cells[0]), delimiter)
    names = tuple(map(_axis, _cells(comment, delimiter)))
    if len(names) == len(cells) and set(names) >= set("xyz"):
        return _Start(skip, names, len(cells), None, delimiter)
    return _Start(skip, (), len(cells), None, delimiter)


def _cells(line: str, delimiter: str | None) -> list[str]:
    joined = re.sub(r"\s+(?=[\[(])", "", line.strip())  # "X [m] Y [m]" are two names
    return [cell.strip().strip("\"'") for cell in joined.split(delimiter)]


def _axis(name: str) -> str:
    """ "X [m]" is x."""
    plain = re.sub(r"\s*[\[(].*", "", name).strip().lower()
    return _XYZ.get(plain, plain)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _check_no_counter(points: NDArray[Any], n_columns: int) -> None:
    """A ValueError where the first of more than three columns just counts the lines."""
    count = points[:, 0] - points[:1, 0]
    if n_columns > 3 and len(points) > 2 and (count == np.arange(len(points))).all():
        raise ValueError("its first column counts the lines; name the columns in a header line, such as: id x y z")
