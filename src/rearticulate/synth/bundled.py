"""The sequences that come with the package (`data/README.md` says where each is from)."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from rearticulate.errors import InputError

_FOLDER = Path(str(files("rearticulate") / "data"))


def names() -> list[str]:
    """Names of the bundled sequences, in alphabetical order."""
    return sorted(file.stem for file in _FOLDER.glob("*.npz") if not file.name.endswith(".truth.npz"))


def path(name: str) -> Path:
    """The `.npz` of a bundled sequence."""
    if name not in names():
        raise InputError(f"there is no bundled sequence {name!r}; there are {', '.join(names())}")
    return _FOLDER / f"{name}.npz"


def truth_path(name: str) -> Path:
    """The `.truth.npz` of a bundled sequence."""
    return path(name).with_name(f"{name}.truth.npz")
