"""Tables with x, y, z among their columns, as text or packed: what PLY, PCD and plain text have in common."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.io.budget import check_promise

CUT = "points of a last line without a line end, which may be cut, dropped"
Note = Callable[[str, int], None]  # what a reader did, and to how many points

_TAIL = 65_536  # bytes at the end of a file in which the last lines are looked at
_LINES = 20


@dataclass(frozen=True)
class Column:
    """Name of a column, NumPy code of its numbers ("f4"), how many of them a row has."""

    name: str
    kind: str
    count: int = 1

    @property
    def n_bytes(self) -> int:
        return int(self.kind[1:]) * self.count


def row_bytes(columns: Iterable[Column]) -> int:
    """Of one packed row."""
    return sum(column.n_bytes for column in columns)


def where_xyz(names: Sequence[str]) -> tuple[int, int, int]:
    """Which of the columns are x, y and z. Raises ValueError where one is missing or named twice; others may be."""
    if lacking := [axis for axis in "xyz" if axis not in names]:
        raise ValueError(f"it has no {', '.join(lacking)}; it has {', '.join(names[:12]) or 'nothing'}")
    if twice := [axis for axis in "xyz" if names.count(axis) > 1]:
        raise ValueError(f"it has {' and '.join(twice)} more than once")
    x, y, z = (names.index(axis) for axis in "xyz")
    return x, y, z


def read_packed(path: Path, offset: int, n: int, columns: Sequence[Column], order: str = "<") -> NDArray[Any]:
    """(n, 3) x, y, z of n packed rows after `offset` bytes. order: "<" or ">"."""
    starts = np.cumsum([0, *(column.n_bytes for column in columns)]).tolist()
    xyz = where_xyz([column.name for column in columns])
    if any(columns[c].count != 1 for c in xyz):
        raise ValueError("x, y and z must be one number each")
    layout = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": [order + columns[c].kind for c in xyz],
            "offsets": [starts[c] for c in xyz],
            "itemsize": starts[-1],
        }
    )
    rows = np.fromfile(path, layout, count=n, offset=offset)
    check_promise(n, len(rows))
    return np.stack([rows[axis] for axis in "xyz"], axis=1)


def read_lines(
    path: Path,
    skip: int,
    n_columns: int,
    xyz: Sequence[int],
    note: Note,
    *,
    delimiter: str | None = None,
    **layout: Any,
) -> NDArray[np.float64]:
    """(N, 3) numbers of the columns `xyz` of a text; every line must have `n_columns`, the others may be any words.

    skip: lines before. layout: see `numpy.loadtxt`. Raises ValueError that names the line. A last point whose number
    may be cut is left out and noted.
    """
    kinds = [(f"column_{c}", "f8" if c in xyz else "U1") for c in range(n_columns)]
    rows = np.loadtxt(path, np.dtype(kinds), delimiter=delimiter, skiprows=skip, ndmin=1, **layout)
    points = np.stack([rows[f"column_{c}"] for c in xyz], axis=1)
    if max(xyz) == n_columns - 1 and len(points) and may_be_cut(path, delimiter):
        note(CUT, 1)
        return points[:-1]
    return points


def count_lines(path: Path, offset: int) -> int:
    """Lines that are not blank after `offset` bytes."""
    with open(path, "rb") as file:
        file.seek(offset)
        return sum(1 for line in file if not line.isspace())


def may_be_cut(path: Path, delimiter: str | None = None) -> bool:
    """Does the text end within a line, so that its last number may be a part of the one that was meant?

    Not where numbers are written with a fixed number of decimals (or of exponent digits) and the last has them all.
    """
    with open(path, "rb") as file:
        file.seek(max(file.seek(0, 2) - _TAIL, 0))
        tail = file.read().decode("latin-1")
    lines = tail.splitlines()[-_LINES:]
    if len(lines) < 2 or tail.endswith(("\n", "\r")):
        return False
    shapes = {_decimals((line.split(delimiter) or [""])[-1]) for line in lines}
    return len(shapes) > 1 or not any(shapes)


def _decimals(text: str) -> str:
    """What follows the point of a number, every digit as 0 and every sign as +; nothing where it has no point."""
    digits = re.sub(r"\d", "0", text.strip().partition(".")[2])
    return digits.replace("-", "+")
