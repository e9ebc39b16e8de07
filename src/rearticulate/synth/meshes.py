"""Mesh files of a URDF: where they are, and their triangles."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from rearticulate.errors import InputError, one_line

Array = NDArray[np.floating]

LARGEST_FILE = 512 * 2**20  # bytes of one mesh
LARGEST = 1e9  # of a coordinate, in any unit
_PACKAGE = ("package://", "model://")


def find_mesh(name: str, urdf: Path, folders: list[Path]) -> Path:
    """The file that a URDF calls `name`: package://PACKAGE/FILE, file://FILE, or relative to the URDF.

    A package is looked for in `folders` and in every folder above the URDF; each of them may also be the package. No
    file is taken from outside of the package, of `folders`, or of the URDF's own package (`home_of`).
    """
    here, home = urdf.resolve().parent, home_of(urdf)
    scheme = next((s for s in _PACKAGE if name.startswith(s)), None)
    if scheme is None:
        if "://" in name.removeprefix("file://"):
            raise InputError(f"{urdf}: mesh {name!r}: only package:// and file:// are read")
        rest = re.sub("^/+", "/", name.removeprefix("file://"))
        candidates = [(home, here / rest), *((folder, folder / rest) for folder in [*folders, home])]
        candidates += [(folder, here / rest) for folder in folders]
    else:
        package, _, rest = name.removeprefix(scheme).lstrip("/").partition("/")
        if package in ("", ".", ".."):
            raise InputError(f"{urdf}: mesh {name!r} names no package")
        above = [*folders, here, *here.parents]
        candidates = [(folder / package, folder / package / rest) for folder in above]
        candidates += [(folder, folder / rest) for folder in above if folder.name == package]
    for root, candidate in candidates:
        if _inside(root, candidate) and os.path.isfile(candidate):  # also of names that no system takes
            return candidate
    where = ", ".join(str(folder) for folder in folders) or "none given"
    outside = "they must hold the package" if scheme else f"no file outside of them and of {home} is read"
    raise InputError(f"{urdf}: mesh {name} not found; package folders: {where} ({outside})")


def home_of(urdf: Path) -> Path:
    """The folder of the package a URDF belongs to, the next one upwards with a package.xml; else that above its own."""
    above = urdf.resolve().parents
    return next((folder for folder in above if (folder / "package.xml").is_file()), above[min(1, len(above) - 1)])


def _inside(root: Path, file: Path) -> bool:
    """By name: links in a package may lead anywhere, their owner put them there."""
    return Path(os.path.abspath(file)).is_relative_to(os.path.abspath(root))


def load_triangles(path: Path) -> Array:
    """(T, 3, 3) triangles of all objects in a mesh file, each at its place in the file's scene."""
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(f"{path}: larger than {LARGEST_FILE // 2**20} MiB; simplify this mesh")
    try:
        triangles = np.asarray(trimesh.load_scene(path).to_mesh().triangles, dtype=np.float64)
    except Exception as error:  # each format has its own reader with its own failures
        raise InputError(f"{path}: not a mesh that can be read ({one_line(error)})") from error
    if len(triangles) == 0 or not (np.abs(triangles) < LARGEST).all():
        what = "it has no triangles" if len(triangles) == 0 else "some of its coordinates are not finite or absurd"
        raise InputError(f"{path}: not a mesh that can be read ({what})")
    return triangles
