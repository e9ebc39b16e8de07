"""One file, one cloud: (N, 3) points of a frame, as the file has them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.errors import InputError
from rearticulate.io.budget import check_file
from rearticulate.io.mesh import read_mesh
from rearticulate.io.npz import open_numpy, read_errors
from rearticulate.io.pcd import read_pcd
from rearticulate.io.ply import read_cloud, read_header
from rearticulate.io.rows import Note
from rearticulate.io.text import COLUMNS, first_three, read_text

Points = NDArray[Any]


@dataclass(frozen=True)
class Reading:
    """How a frame is read: points drawn from a mesh and with which rng, bytes allowed, whom to tell what was done."""

    samples: int
    rng: np.random.Generator
    max_bytes: int
    note: Note


def read_points(path: Path, reading: Reading) -> Points:
    """The (N, 3) points of a file. Of a file with faces: points drawn from its surface, area-weighted."""
    with read_errors(path, f"{path.suffix.lower()} file"):
        check_file(path, reading.max_bytes)
        points = READERS[path.suffix.lower()](path, reading)
    return check_points(str(path), points, "one frame (N, 3)", reading.note)


def check_points(what: str, points: Points, expected: str, note: Note) -> Points:
    """x, y, z of an array of real numbers (N, 3), or of more columns (see `io.text`) the first three."""
    if points.ndim != 2 or points.shape[1] not in COLUMNS:
        raise InputError(f"{what}: an array of shape {points.shape}, expected {expected}")
    if points.dtype.kind not in "fiu":
        raise InputError(f"{what}: values of type {points.dtype}, expected real numbers")
    first_three(points.shape[1], note, len(points))
    return points[:, :3]


def _read_npy(path: Path, reading: Reading) -> Points:
    with open_numpy(path, reading.max_bytes) as array:
        return array


def _read_ply(path: Path, reading: Reading) -> Points:
    header = read_header(path)
    if header.is_cloud:
        return read_cloud(path, header, reading.note)
    return _read_mesh(path, reading, header.count("face"))


def _read_mesh(path: Path, reading: Reading, n_faces: int = 0) -> Points:
    return read_mesh(path, reading.samples, reading.rng, reading.note, n_faces=n_faces, max_bytes=reading.max_bytes)


READERS: dict[str, Callable[[Path, Reading], Points]] = {
    ".npy": _read_npy,
    ".xyz": lambda path, reading: read_text(path, reading.note),
    ".txt": lambda path, reading: read_text(path, reading.note),
    ".csv": lambda path, reading: read_text(path, reading.note),
    ".pcd": lambda path, reading: read_pcd(path, reading.note, reading.max_bytes),
    ".ply": _read_ply,
    ".obj": _read_mesh,
    ".stl": _read_mesh,
    ".off": _read_mesh,
    ".glb": _read_mesh,
}
