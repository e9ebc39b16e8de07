"""Files named by the next free number: 001, 002, ..."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from pathlib import Path

from rearticulate.io.atomic import reserve

_writing = threading.Lock()


def write_numbered(folder: Path, suffix: str, write: Callable[[Path], object]) -> Path:
    """Let `write` make the first file that is not there, and return its path. A number is taken once: threads wait for
    each other, and InputError says where another run is writing that very file."""
    with _writing:
        while True:
            names = (folder / f"{k:03d}{suffix}" for k in itertools.count(1))
            path = next(path for path in names if not path.exists())
            with reserve(path):
                if not path.exists():  # nor made by another run just before
                    write(path)
                    return path
