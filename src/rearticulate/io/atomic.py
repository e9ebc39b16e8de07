"""Files and folders that appear whole or not at all: written under a hidden sibling name, then renamed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rearticulate.errors import FitError


@contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path that replaces `path` when the block ends well; a failed write is a one-line FitError."""
    path = Path(path)
    with _write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = _sibling(path, "partial")
        try:
            yield partial
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)


@contextmanager
def atomic_folder(folder: str | os.PathLike[str], keep: str = "") -> Iterator[Path]:
    """As `atomic_file` for a whole folder. The old one goes last, after its sub-folder `keep` has moved to the new."""
    folder = Path(folder).resolve()
    with _write_errors(folder):
        partial = _sibling(folder, "partial")
        try:
            partial.mkdir(parents=True)
            yield partial
            _swap(partial, folder, keep)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def _sibling(path: Path, suffix: str) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.{suffix}")


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FitError(f"{path}: cannot be written ({error.strerror or error})") from error


def _swap(new: Path, folder: Path, keep: str) -> None:
    if not folder.exists():
        new.rename(folder)
        return
    old = _sibling(folder, "old")
    folder.rename(old)
    try:
        new.rename(folder)
    except OSError:
        old.rename(folder)
        raise
    if keep and (old / keep).is_dir() and not (folder / keep).exists():
        (old / keep).rename(folder / keep)
    shutil.rmtree(old, ignore_errors=True)
