"""Results of single stages, kept so that a stopped fit can go on where it was."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError
from rearticulate.io.npz import load_arrays, save_arrays

_FINGERPRINT = "fingerprint"
Shape = tuple[int | str, ...]


class StageStore:
    """One `.npz` a stage in `folder`, each with the fingerprint of what it was made from; no folder, no memory."""

    def __init__(self, folder: str | Path | None) -> None:
        self.folder = None if folder is None else Path(folder)

    def load(
        self, key: str, fingerprint: str, shapes: Mapping[str, Shape] | None = None
    ) -> dict[str, np.ndarray] | None:
        """The arrays saved under `key`, or None where there are none, they are damaged or made from something else.

        shapes: names and shapes that are expected, a length by its letter where it is free: one letter, one length.
        """
        path = self._path(key)
        if path is None or not path.is_file():
            return None
        try:
            arrays = load_arrays(path)
        except InputError:
            return None
        if str(arrays.pop(_FINGERPRINT, "")) != fingerprint or not _fits(arrays, shapes):
            return None
        return arrays

    def save(self, key: str, fingerprint: str, arrays: Mapping[str, Any]) -> None:
        """Keep `arrays` (no objects) under `key`; replaces what was there, whole or not at all."""
        path = self._path(key)
        if path is None:
            return
        if _FINGERPRINT in arrays:
            raise ValueError(f"an array cannot be called {_FINGERPRINT!r}")
        save_arrays(path, {**arrays, _FINGERPRINT: np.str_(fingerprint)})

    def _path(self, key: str) -> Path | None:
        if not re.fullmatch(r"[\w-][\w.-]*", key):
            raise ValueError(f"a stage is named by letters, digits, '.', '_' and '-', not {key!r}")
        return None if self.folder is None else self.folder / f"{key}.npz"


def _fits(arrays: Mapping[str, np.ndarray], shapes: Mapping[str, Shape] | None) -> bool:
    if shapes is None:
        return True
    if set(arrays) != set(shapes) or any(array.dtype.kind not in "biuf" for array in arrays.values()):
        return False
    lengths: dict[int | str, int] = {}
    return all(
        arrays[name].ndim == len(shape)
        and all(
            n == (wanted if isinstance(wanted, int) else lengths.setdefault(wanted, n))
            for n, wanted in zip(arrays[name].shape, shape, strict=True)
        )
        for name, shape in shapes.items()
    )
