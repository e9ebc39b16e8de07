"""Folders that a command writes, and may replace only where it wrote them before: a file in them tells."""

from __future__ import annotations

from pathlib import Path

from rearticulate.errors import InputError


def check_folder(out: Path, mark: str, what: str, overwrite: bool) -> None:
    """An InputError unless `what` ("export") may be written to `out`: new, empty, or with its `mark` and allowed."""
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out}: exists and is not a folder")
    if any(out.iterdir()) and not (out / mark).exists():
        raise InputError(f"{out}: not empty and not an earlier {what}, so it is not replaced; name another folder")
    if (out / mark).exists() and not overwrite:
        raise InputError(f"{out}: holds an earlier {what}; name another folder or ask for --overwrite")
