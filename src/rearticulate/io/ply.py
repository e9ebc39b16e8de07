"""Stanford PLY: the header, checked against the file; clouds without faces (any property order, ascii or binary); a
coloured-cloud writer.

Meshes go through trimesh. Clouds are read here because a ten-million-point ascii file must not become as many objects.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from rearticulate.io.budget import check_held, check_promise
from rearticulate.io.rows import Column, Note, count_lines, read_lines, read_packed, row_bytes, where_xyz
from rearticulate.records import Array
from rearticulate.schema import finite

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8",
}  # fmt: skip
_BYTE_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class PlyElement:
    """n rows of an element. columns: its properties; of a list the column of its length, with the type of its items
    in `lists` by the name of the property."""

    name: str
    n: int
    columns: tuple[Column, ...]
    lists: dict[str, str]


@dataclass(frozen=True)
class PlyHeader:
    """encoding "ascii", "binary_little_endian" or "binary_big_endian"; the elements in file order; header size in bytes
    and lines."""

    encoding: str
    elements: tuple[PlyElement, ...]
    n_bytes: int
    n_lines: int

    def count(self, name: str) -> int:
        """How many of an element."""
        return sum(element.n for element in self.elements if element.name == name)

    @property
    def is_cloud(self) -> bool:
        """Vertices first, of fixed size, and nothing that spans a surface."""
        first = self.elements[0] if self.elements else PlyElement("", 0, (), {})
        return first.name == "vertex" and not first.lists and self.count("face") + self.count("tristrips") == 0


def read_header(path: Path) -> PlyHeader:
    """The header of a PLY file; a ValueError says what is wrong with it, or with the file that does not keep it."""
    with open(path, "rb") as file:
        if file.readline(16).strip() != b"ply":
            raise ValueError("it does not start with 'ply'")
        header = _parse_header(file)
    if header.encoding == "ascii":
        check_promise(sum(element.n for element in header.elements), count_lines(path, header.n_bytes), "lines")
    else:
        _check_bytes(path, header)
    return header


def _parse_header(file: BinaryIO) -> PlyHeader:
    encoding, elements = "", []
    columns: list[Column] = []
    lists: dict[str, str] = {}
    for n_lines, line in enumerate(iter(lambda: file.readline(4096), b""), start=2):
        match line.decode("ascii", "replace").split():
            case ["end_header"]:
                if encoding != "ascii" and encoding not in _BYTE_ORDER:
                    raise ValueError("the header names no known format")
                done = tuple(PlyElement(name, n, tuple(c), found) for name, n, c, found in elements)
                return PlyHeader(encoding, done, file.tell(), n_lines)
            case ["format", encoding, *_]:
                pass
            case ["element", name, n]:
                if int(n) < 0:
                    raise ValueError(f"the header promises {n} of {name}")
                columns, lists = [], {}
                elements.append((name, int(n), columns, lists))
            case ["property", "list", length, items, name]:
                columns.append(Column(name, _type(length, name)))
                lists[name] = _type(items, name)
            case ["property", kind, name]:
                columns.append(Column(name, _type(kind, name)))
    raise ValueError("the header has no end")


def _type(kind: str, name: str) -> str:
    if kind not in _TYPES:
        raise ValueError(f"the type {kind!r} of {name!r} is not known")
    return _TYPES[kind]


def _check_bytes(path: Path, header: PlyHeader) -> None:
    """A ValueError where the elements are not as long as what follows the header; less than a last row may be over."""
    held = path.stat().st_size - header.n_bytes
    least = [element.n * row_bytes(element.columns) for element in header.elements]
    check_held(sum(least), held, "bytes")
    data = np.memmap(path, np.uint8, "r", header.n_bytes) if held else np.zeros(0, dtype=np.uint8)
    end = last = 0
    for element in header.elements:
        start, end = end, _end(data, end, element, _BYTE_ORDER[header.encoding])
        last = (end - start) // element.n if element.n else last
    if not end <= held < end + max(last, 1):
        raise ValueError(f"the header promises {end} bytes, {held} are there")


def _end(data: NDArray[np.uint8], start: int, element: PlyElement, order: str) -> int:
    """Where a packed element ends. data: (B,) bytes."""
    if not element.lists:
        return start + element.n * row_bytes(element.columns)
    row = _row_end(data, start, element, order) - start if element.n else 0
    if start + element.n * row <= len(data) and _is_uniform(data, start, element, order, row):
        return start + element.n * row
    end = start
    for _ in range(element.n):
        end = _row_end(data, end, element, order)
    return end


def _row_end(data: NDArray[np.uint8], end: int, element: PlyElement, order: str) -> int:
    for column in element.columns:
        if column.name in element.lists:
            end += _length(data, end, order + column.kind) * int(element.lists[column.name][1:])
        end += column.n_bytes
    return end


def _length(data: NDArray[np.uint8], start: int, kind: str) -> int:
    stop = start + np.dtype(kind).itemsize
    if stop > len(data):
        raise ValueError("cut off within its lists")
    length = float(data[start:stop].view(kind)[0])
    if not (length >= 0 and math.isfinite(length)):
        raise ValueError(f"a list of length {length}")
    return int(length)


def _is_uniform(data: NDArray[np.uint8], start: int, element: PlyElement, order: str, row: int) -> bool:
    """Have all rows the list lengths of the first?"""
    at = start
    for column in element.columns:
        if column.name in element.lists:
            kind = order + column.kind
            lengths = np.ndarray(element.n, kind, data, at, (row,))
            if element.n and (lengths != lengths[0]).any():
                return False
            at += (_length(data, at, kind) if element.n else 0) * int(element.lists[column.name][1:])
        at += column.n_bytes
    return True


def read_cloud(path: Path, header: PlyHeader, note: Note = lambda what, count: None) -> NDArray[np.floating]:
    """(N, 3) vertices of a file for which `header.is_cloud` holds. note: is told of what was left out."""
    vertex = header.elements[0]
    if header.encoding != "ascii":
        return read_packed(path, header.n_bytes, vertex.n, vertex.columns, _BYTE_ORDER[header.encoding])
    names = [column.name for column in vertex.columns]
    xyz = where_xyz(names)
    if vertex.n == 0:
        return np.zeros((0, 3))
    layout = {"max_rows": vertex.n, "comments": None, "encoding": "latin-1"}
    return read_lines(path, header.n_lines, len(names), xyz, note, **layout)


def write_cloud(path: Path, points: Array, colors: NDArray[np.uint8]) -> None:
    """Binary little-endian PLY. points: (N, 3), finite (FitError), kept as float64. colors: (N, 3)."""
    rows = np.zeros(len(points), dtype=[("xyz", "<f8", 3), ("rgb", "u1", 3)])
    rows["xyz"], rows["rgb"] = finite(path.name, points), colors
    header = io.StringIO()
    header.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n")
    header.writelines(f"property double {axis}\n" for axis in "xyz")
    header.writelines(f"property uchar {channel}\n" for channel in ("red", "green", "blue"))
    header.write("end_header\n")
    path.write_bytes(header.getvalue().encode("ascii") + rows.tobytes())
