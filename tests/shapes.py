"""Every call in the rooms of the solver checks the shapes in its signature, while tests run."""

from __future__ import annotations

import ast

from jaxtyping import _import_hook, install_import_hook

ROOMS = ("geometry", "observe", "parts", "joints", "search", "methods", "pipeline", "results")


def check_shapes() -> None:
    """Before the rooms are imported. Compiled functions are left out: Numba takes plain functions alone."""
    unchecked = _import_hook._is_no_type_check
    _import_hook._is_no_type_check = lambda decorator: unchecked(decorator) or "njit" in ast.unparse(decorator)
    install_import_hook([f"rearticulate.{room}" for room in ROOMS], "beartype.beartype")
