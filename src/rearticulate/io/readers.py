"""One file, one cloud: (N, 3) points of a frame, as the file has them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.errors import InputError, one_line
from rearticulate.io.npz import open_numpy, read_errors
from rearticulate.io.ply import read_cloud, read_header

Points = NDArray[Any]


def natural_order(names: Iterable[str]) -> list[str]:
    """Names sorted as people count: frame2 before frame10."""
    return sorted(names, key=lambda name: ([_chunk(c) for c in re.split(r"(\d+)", name)], name))


def _chunk(text: str) -> tuple[int, str]:
    return (int(text), "") if text.isdecimal() else (-1, text.lower())


def read_points(path: Path, samples: int, rng: np.random.Generator) -> Points:
    """The (N, 3) points of a file. Of a file with faces: `samples` points drawn from its surface, area-weighted."""
    with read_errors(path, f"{path.suffix.lower()} file"):
        points = READERS[path.suffix.lower()](path, samples, rng)
    return check_points(str(path), points, "one frame (N, 3)")


def check_points(what: str, points: Points, expected: str) -> Points:
    """The same array, if it is one of real numbers (N, 3)."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{what}: an array of shape {points.shape}, expected {expected}")
    if points.dtype.kind not in "fiu":
        raise InputError(f"{what}: values of type {points.dtype}, expected real numbers")
    return points


def _read_npy(path: Path, samples: int, rng: np.random.Generator) -> Points:
    with open_numpy(path) as array:
        return array


def _read_text(path: Path, samples: int, rng: np.random.Generator) -> Points:
    """Three or more columns, x y z first; blanks, commas or semicolons between; # comments, one header line."""
    skip, first = 0, ""
    with open(path, encoding="utf-8-sig") as file:
        for line_number, line in enumerate(file):
            if line.strip() and not line.lstrip().startswith(("#", "//")):
                skip, first = line_number, line
                break
    delimiter = next((mark for mark in ",;" if mark in first), None)
    if not _is_number(first.split(delimiter)[0] if first else ""):
        skip += 1
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*input contained no data")
        layout: Any = {"delimiter": delimiter, "usecols": (0, 1, 2), "skiprows": skip}
        try:
            points = np.loadtxt(path, ndmin=2, encoding="utf-8-sig", **layout)
        except ValueError as error:
            raise ValueError(f"expected x y z on every line: {one_line(error)}") from error
    return points if points.size else np.zeros((0, 3))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_pcd(path: Path, samples: int, rng: np.random.Generator) -> Points:
    try:
        from pypcd4.pypcd4 import PointCloud
    except ImportError as error:
        raise InputError(f"{path}: reading .pcd needs the package pypcd4 (pip install pypcd4)") from error
    cloud = PointCloud.from_path(path)
    if missing := {"x", "y", "z"} - set(cloud.fields):
        raise ValueError(f"it has no field {', '.join(sorted(missing))}")
    if len(cloud.pc_data) != cloud.metadata.points:
        raise ValueError(f"cut off: the header promises {cloud.metadata.points} points, {len(cloud.pc_data)} are there")
    return np.stack([cloud.pc_data[axis] for axis in "xyz"], axis=1)


def _read_ply(path: Path, samples: int, rng: np.random.Generator) -> Points:
    header = read_header(path)
    if header.is_cloud:
        return read_cloud(path, header)
    return _read_mesh(path, samples, rng, header.counts.get("face", 0))


def _read_mesh(path: Path, samples: int, rng: np.random.Generator, n_faces: int = 0) -> Points:
    """Points on the surface, or the vertices of a file without faces. n_faces: how many the file promises."""
    import trimesh

    geometry = trimesh.load_scene(path, process=False).dump()
    meshes = [g for g in geometry if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    if sum(len(mesh.faces) for mesh in meshes) < n_faces:
        raise ValueError(f"cut off: the header promises {n_faces} faces")
    mesh: Any = trimesh.util.concatenate(meshes) if meshes else None
    if mesh is None or not mesh.area > 0:
        clouds: list[Any] = [g for g in geometry if hasattr(g, "vertices")]
        if not any(len(cloud.vertices) for cloud in clouds):
            raise ValueError("it holds no points")
        return np.concatenate([np.asarray(cloud.vertices) for cloud in clouds])
    return np.asarray(trimesh.sample.sample_surface(mesh, samples, seed=int(rng.integers(2**31)))[0])


READERS: dict[str, Callable[[Path, int, np.random.Generator], Points]] = {
    ".npy": _read_npy,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".pcd": _read_pcd,
    ".ply": _read_ply,
    ".obj": _read_mesh,
    ".stl": _read_mesh,
    ".off": _read_mesh,
    ".glb": _read_mesh,
}
