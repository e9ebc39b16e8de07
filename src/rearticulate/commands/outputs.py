"""What a command may replace: a file or a folder only when it is told to, a folder only where it wrote it before."""

from __future__ import annotations

from pathlib import Path

from rearticulate.errors import InputError


def check_file(out: Path, overwrite: bool) -> None:
    """An InputError unless a file may be written to `out`."""
    if out.is_dir():
        raise InputError(f"{out}: is a folder; name a file")
    if out.exists() and not overwrite:
        raise InputError(f"{out}: exists; name another file or ask for --overwrite")


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
