"""Optional packages: a clear line where one is absent."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rearticulate.errors import InputError


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """An InputError that names the extra to install where a package of it cannot be imported."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "rearticulate":
            raise
        raise InputError(f'this needs the package {error.name}: pip install "rearticulate[{extra}]"') from error
