"""Stanford PLY: the header, clouds without faces (any property order, ascii or binary), and a coloured-cloud writer.

Meshes go through trimesh. Clouds are read here because a ten-million-point ascii file must not become as many objects.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

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
class PlyHeader:
    """encoding "ascii", "binary_little_endian" or "binary_big_endian"; how many of each element, in file order;
    the vertex properties as (name, type), where a list property has the type "list"; header size in bytes and lines."""

    encoding: str
    counts: dict[str, int]
    vertex: tuple[tuple[str, str], ...]
    n_bytes: int
    n_lines: int

    @property
    def is_cloud(self) -> bool:
        """Vertices first, of fixed size, and nothing that spans a surface."""
        first = next(iter(self.counts), "")
        surfaces = self.counts.get("face", 0) + self.counts.get("tristrips", 0)
        return first == "vertex" and surfaces == 0 and all(kind != "list" for _, kind in self.vertex)


def read_header(path: Path) -> PlyHeader:
    """The header of a PLY file; a ValueError says what is wrong with it."""
    with open(path, "rb") as file:
        if file.readline(16).strip() != b"ply":
            raise ValueError("it does not start with 'ply'")
        return _parse_header(file)


def _parse_header(file: BinaryIO) -> PlyHeader:
    encoding, element, counts, vertex = "", "", {}, []
    for n_lines, line in enumerate(iter(lambda: file.readline(4096), b""), start=2):
        match line.decode("ascii", "replace").split():
            case ["end_header"]:
                if encoding != "ascii" and encoding not in _BYTE_ORDER:
                    raise ValueError("the header names no known format")
                return PlyHeader(encoding, counts, tuple(vertex), file.tell(), n_lines)
            case ["format", encoding, *_]:
                pass
            case ["element", element, count]:
                counts[element] = int(count)
            case ["property", "list", *_, name] if element == "vertex":
                vertex.append((name, "list"))
            case ["property", kind, name] if element == "vertex":
                if kind not in _TYPES:
                    raise ValueError(f"the type {kind!r} of {name!r} is not known")
                vertex.append((name, _TYPES[kind]))
    raise ValueError("the header has no end")


def read_cloud(path: Path, header: PlyHeader) -> NDArray[np.floating]:
    """(N, 3) vertices of a file for which `header.is_cloud` holds."""
    names = [name for name, _ in header.vertex]
    if not {"x", "y", "z"} <= set(names):
        raise ValueError("its vertices have no x, y, z")
    n = header.counts["vertex"]
    if header.encoding == "ascii":
        xyz = _read_ascii(path, header.n_lines, n, [names.index(axis) for axis in "xyz"])
    else:
        order = _BYTE_ORDER[header.encoding]
        dtype = np.dtype([(name, order + kind) for name, kind in header.vertex])
        rows = np.fromfile(path, dtype, count=n, offset=header.n_bytes)
        xyz = np.stack([rows[axis] for axis in "xyz"], axis=1)
    if len(xyz) < n:
        raise ValueError(f"cut off: the header promises {n} points, {len(xyz)} are there")
    return xyz


def _read_ascii(path: Path, skip: int, n: int, columns: list[int]) -> NDArray[np.floating]:
    if n == 0:
        return np.zeros((0, 3))
    return np.loadtxt(path, skiprows=skip, max_rows=n, usecols=columns, ndmin=2, encoding="latin-1")


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
