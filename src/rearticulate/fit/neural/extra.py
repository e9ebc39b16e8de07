"""What the paper's recipe needs beyond the package's own dependencies."""

from __future__ import annotations

from importlib.util import find_spec

from rearticulate.errors import InputError


def require(*modules: str) -> None:
    """Raise InputError when one of the modules is not installed."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise InputError(f"this needs {' and '.join(missing)}: pip install 'rearticulate[paper]'")
