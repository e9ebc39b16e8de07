"""Files named by the next free number: 001, 002, ..."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path

from rearticulate.errors import FitError


def write_numbered(folder: Path, suffix: str, write: Callable[[Path], object]) -> Path:
    """What `write` puts into a file, under the first name that is free: whole or not at all, and never another's,
    whoever else writes there. Returns the path; a failed write is a one-line FitError."""
    partial = folder / f".{os.getpid()}.{threading.get_ident()}.partial{suffix}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            write(partial)
            k = 1
            while not _named(partial, path := folder / f"{k:03d}{suffix}"):
                k += 1
            return path
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise FitError(f"{folder}: cannot be written ({error.strerror or error})") from error


def _named(partial: Path, path: Path) -> bool:
    """Give a file a second name, unless that is taken."""
    if path.exists():
        return False
    try:
        os.link(partial, path)
    except FileExistsError:
        return False
    except OSError:  # no second names on this file system
        try:
            path.touch(exist_ok=False)
        except FileExistsError:
            return False
        os.replace(partial, path)
    return True
