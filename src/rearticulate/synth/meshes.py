"""Mesh files of a URDF: where they are, and their triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from rearticulate.errors import InputError

Array = NDArray[np.floating]

_PACKAGE = ("package://", "model://")


def find_mesh(name: str, urdf: Path, folders: list[Path]) -> Path:
    """The file that a URDF calls `name`: package://PACKAGE/FILE, file://FILE, or relative to the URDF.

    A package is looked for in `folders` and in every folder above the URDF; each of them may also be the package.
    """
    above = list(urdf.resolve().parents)
    scheme = next((s for s in _PACKAGE if name.startswith(s)), None)
    if scheme is None:
        candidates = [above[0] / name.removeprefix("file://"), *(folder / name for folder in folders)]
    else:
        package, _, rest = name.removeprefix(scheme).partition("/")
        candidates = [folder / package / rest for folder in [*folders, *above]]
        candidates += [folder / rest for folder in [*folders, *above] if folder.name == package]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    where = ", ".join(str(folder) for folder in folders) or "none given"
    raise InputError(f"{urdf}: mesh {name} not found; package folders: {where} (they must hold the package)")


def load_triangles(path: Path) -> Array:
    """(T, 3, 3) triangles of all objects in a mesh file, each at its place in the file's scene."""
    try:
        triangles = np.asarray(trimesh.load_scene(path).to_mesh().triangles, dtype=np.float64)
    except Exception as error:  # each format has its own reader with its own failures
        raise InputError(f"{path}: not a mesh that can be read ({error})") from error
    if len(triangles) == 0:
        raise InputError(f"{path}: not a mesh that can be read (it has no triangles)")
    return triangles
