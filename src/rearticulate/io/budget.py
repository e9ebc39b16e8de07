"""How much a file may ask for. A header is a promise of a stranger: it is compared with what is there, and what a
packed file would unpack to with a budget, before memory is taken for either.
"""

from __future__ import annotations

import stat
from pathlib import Path

from rearticulate.errors import InputError

MAX_BYTES = 2 * 2**30  # of one file, unpacked
_SMALL = 256 * 2**20
_RATIO = 100  # measured numbers never pack as well, endless zeros do


def check_file(path: Path, max_bytes: int = MAX_BYTES) -> int:
    """Size in bytes of a plain file within the budget. Raises InputError for larger ones, pipes and devices."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: not a plain file")
    if status.st_size > max_bytes:
        raise InputError(f"{path}: {size(status.st_size)}{_over(max_bytes)}")
    return status.st_size


def check_unpacked(what: str, n_bytes: int, packed: int, max_bytes: int = MAX_BYTES) -> None:
    """An InputError where `packed` bytes of a file would unpack to too many. what: file, or file and array."""
    if n_bytes > max_bytes:
        raise InputError(f"{what}: unpacks to {size(n_bytes)}{_over(max_bytes)}")
    if n_bytes > max(_SMALL, _RATIO * packed):
        raise InputError(f"{what}: {size(packed)} that unpack to {size(n_bytes)} are no measured points")


def check_held(promised: int, held: int, unit: str) -> None:
    """A ValueError where the header promises more than the file holds."""
    if promised > held:
        raise ValueError(f"cut off: the header promises {promised} {unit}, {held} are there")


def check_promise(promised: int, held: int, unit: str = "points") -> None:
    """A ValueError where the header promises more than the file holds, or less."""
    check_held(promised, held, unit)
    if promised < held:
        raise ValueError(f"the header promises {promised} {unit}, but {held} are there")


def size(n_bytes: int) -> str:
    """12.5 MB."""
    return f"{n_bytes / 1e9:.3g} GB" if n_bytes >= 1e9 else f"{n_bytes / 1e6:.3g} MB"


def _over(max_bytes: int) -> str:
    return f", more than the {size(max_bytes)} allowed for one file; --max-bytes (max_bytes in Python) allows more"
