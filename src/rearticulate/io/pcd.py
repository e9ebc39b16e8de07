"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed, any fields beside x, y, z."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.io.budget import MAX_BYTES, check_held, check_promise, check_unpacked
from rearticulate.io.rows import Column, Note, count_lines, read_lines, read_packed, row_bytes, where_xyz

_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_MAX_LINES = 64  # of a header, comments too


@dataclass(frozen=True)
class PcdHeader:
    """The fields of a point, how many points, encoding "ascii", "binary" or "binary_compressed", header size in bytes
    and lines."""

    columns: tuple[Column, ...]
    n: int
    encoding: str
    n_bytes: int
    n_lines: int


def read_pcd(path: Path, note: Note, max_bytes: int = MAX_BYTES) -> NDArray[Any]:
    """(N, 3) points of a file. Raises ValueError where header and contents disagree. note: see `rows.read_lines`."""
    header = _read_header(path)
    held = path.stat().st_size - header.n_bytes
    if header.n == 0 and held <= 8:
        return np.zeros((0, 3))
    if header.encoding == "binary":
        check_promise(header.n, held // row_bytes(header.columns))
        return read_packed(path, header.n_bytes, header.n, header.columns)
    if header.encoding == "binary_compressed":
        return _read_compressed(path, header, max_bytes)
    return _read_ascii(path, header, held, note)


def _read_header(path: Path) -> PcdHeader:
    entries: dict[str, list[str]] = {}
    with open(path, "rb") as file:
        for n_lines in range(1, _MAX_LINES + 1):
            key, *values = file.readline(65_536).decode("utf-8").split() or ["#"]
            if not key.startswith("#"):
                entries[key.upper()] = values
            if key.upper() == "DATA":
                return _header(entries, file.tell(), n_lines)
    raise ValueError("its header has no DATA line")


def _header(entries: dict[str, list[str]], n_bytes: int, n_lines: int) -> PcdHeader:
    names = entries.get("FIELDS", entries.get("COLUMNS", []))
    sizes, kinds = entries.get("SIZE", []), entries.get("TYPE", [])
    counts = entries.get("COUNT", ["1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT of its header differ in length")
    columns = tuple(map(_column, names, kinds, sizes, counts))
    where_xyz([column.name for column in columns])
    n = _number(entries, "WIDTH", 1) * _number(entries, "HEIGHT", 1)
    points = _number(entries, "POINTS", n)
    if "WIDTH" in entries and points != n:
        raise ValueError(f"its header has POINTS {points}, but WIDTH x HEIGHT is {n}")
    encoding = entries["DATA"][0].lower() if entries["DATA"] else ""
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA {encoding!r} is none of ascii, binary and binary_compressed")
    return PcdHeader(columns, points, encoding, n_bytes, n_lines)


def _column(name: str, kind: str, size: str, count: str) -> Column:
    if int(size) not in _SIZES.get(kind, ()) or int(count) < 1:
        raise ValueError(f"the field {name!r} of TYPE {kind}, SIZE {size}, COUNT {count} is none")
    return Column(name, f"{_KINDS[kind]}{int(size)}", int(count))


def _number(entries: dict[str, list[str]], key: str, absent: int) -> int:
    number = int(entries[key][0]) if entries.get(key) else absent
    if number < 0:
        raise ValueError(f"its header has {key} {number}")
    return number


def _read_ascii(path: Path, header: PcdHeader, held: int, note: Note) -> NDArray[Any]:
    n_columns = sum(column.count for column in header.columns)
    check_held(2 * n_columns * header.n, held + 1, "bytes of text")
    check_promise(header.n, count_lines(path, header.n_bytes))
    starts = np.cumsum([0, *(column.count for column in header.columns)]).tolist()
    xyz = [starts[c] for c in where_xyz([column.name for column in header.columns])]
    return read_lines(path, header.n_lines, n_columns, xyz, note, comments=None, encoding="latin-1")


def _read_compressed(path: Path, header: PcdHeader, max_bytes: int) -> NDArray[Any]:
    """One field after the other, packed by LZF."""
    import lzf

    with open(path, "rb") as file:
        file.seek(header.n_bytes)
        packed_size, size = struct.unpack("<II", file.read(8))
        packed = file.read(min(packed_size, path.stat().st_size))
    check_promise(packed_size, len(packed), "packed bytes")
    check_promise(header.n * row_bytes(header.columns), size, "bytes")
    check_unpacked(str(path), size, packed_size, max_bytes)
    data = lzf.decompress(packed, size)
    if data is None or len(data) != size:
        raise ValueError("its packed points are damaged")
    starts = np.cumsum([0, *(column.n_bytes * header.n for column in header.columns)]).tolist()
    xyz = where_xyz([column.name for column in header.columns])
    return np.stack([np.frombuffer(data, "<" + header.columns[c].kind, header.n, starts[c]) for c in xyz], axis=1)
