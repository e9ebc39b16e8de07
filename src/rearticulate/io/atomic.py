"""Files and folders that appear whole or not at all: written under a hidden name beside it, then renamed.

Beside NAME there may be, while a run writes it, .NAME.rearticulate.lock (who may write), .partial (the new one) and
.old (only where the system cannot exchange two folders in one step). What a killed run left of these is put right by
the next one that writes NAME.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from rearticulate.errors import FitError, InputError
from rearticulate.io.exchange import exchange
from rearticulate.io.lock import Busy, locked

PathLike = str | os.PathLike[str]
_reserved = threading.local()


@contextmanager
def reserve(path: PathLike) -> Iterator[Path]:
    """The right to write a file or folder, from before the work until after it; yields its full path.

    Raises InputError where another run (or thread) has it, FitError where nothing can be written. Within the block
    `atomic_file` and `atomic_folder` use the same right.
    """
    path = _full(path)
    mine = _mine()
    if path in mine:
        yield path
        return
    made = _make_parents(path)
    lock = locked(_beside(path, "lock"))
    try:
        with _write_errors(path):
            lock.__enter__()
        mine.add(path)
        try:
            with _write_errors(path):
                _put_right(path)
            yield path
        finally:
            mine.discard(path)
            lock.__exit__(None, None, None)
    except Busy:
        raise InputError(f"{path}: in use by another run") from None
    finally:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()  # only where nothing came into it


@contextmanager
def atomic_file(path: PathLike) -> Iterator[Path]:
    """A temporary path that replaces `path` when the block ends well; a failed write is a one-line FitError."""
    if _in_new_folder(_full(path)):
        with _write_errors(Path(path)):
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            yield Path(path)
        return
    with reserve(path) as whole, _write_errors(Path(path)):
        partial = _beside(whole, "partial")
        try:
            yield partial
            _settle(partial)
            os.replace(partial, whole)
        finally:
            _remove(partial)


@contextmanager
def atomic_folder(folder: PathLike, keep: str = "") -> Iterator[Path]:
    """As `atomic_file` for a whole folder; its sub-folder `keep` stays in it."""
    with reserve(folder) as whole, _write_errors(Path(folder)):
        partial = _beside(whole, "partial")
        try:
            partial.mkdir()
            yield partial
            if keep and (whole / keep).is_dir() and not (partial / keep).exists():
                begun = shutil.ignore_patterns(".*.rearticulate.*")
                shutil.copytree(whole / keep, partial / keep, copy_function=_link, ignore=begun)
            with ThreadPoolExecutor(16) as pool:  # the system writes many at once
                list(pool.map(_settle, (*partial.rglob("*"), partial)))
            _replace(whole, partial)
        finally:
            _remove(partial)


def _mine() -> set[Path]:
    """What this thread has reserved."""
    return vars(_reserved).setdefault("paths", set())


def _in_new_folder(path: Path) -> bool:
    """Whether a file is in a folder that this thread is writing: it becomes whole with that."""
    return any(_beside(folder, "partial") in path.parents for folder in _mine())


def _full(path: PathLike) -> Path:
    """The one name of a folder; a file that is a link is not followed, as it is the link that is replaced."""
    path = Path(os.path.abspath(path))
    return path.resolve() if path.is_dir() else path.parent.resolve() / path.name


def _beside(path: Path, suffix: str) -> Path:
    return path.parent / f".{path.name}.rearticulate.{suffix}"


def _make_parents(path: Path) -> list[Path]:
    """The folders above `path` that were made for it, the deepest first."""
    missing = [folder for folder in path.parents if not os.path.lexists(folder)]
    above = next(folder for folder in path.parents if os.path.lexists(folder))
    if not above.is_dir():
        raise InputError(f"{path}: cannot be there, {above} is not a folder")
    with _write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    return missing


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FitError(f"{path}: cannot be written ({error.strerror or error})") from error


def _put_right(path: Path) -> None:
    """End what a killed run began: an old folder without a new one comes back, all else goes."""
    old = _beside(path, "old")
    if old.exists() and not os.path.lexists(path):
        old.rename(path)
    _remove(old)
    _remove(_beside(path, "partial"))
    if path.is_dir() and not os.access(path, os.W_OK):
        raise PermissionError(13, "Permission denied")


def _replace(folder: Path, new: Path) -> None:
    """`new` takes the name of `folder`, if there is one; a kill in between loses nothing (see `_put_right`)."""
    if not folder.exists():
        new.rename(folder)
    elif not exchange(new, folder):
        old = _beside(folder, "old")
        folder.rename(old)
        try:
            new.rename(folder)
        except OSError:
            old.rename(folder)
            raise
        _remove(old)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def _link(source: str, target: str) -> None:
    """A second name for a file that is never written in place; a copy where the system has no such names."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _settle(path: Path) -> None:
    """What was written is on the disk before it gets its name."""
    if sys.platform == "win32" and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDWR if sys.platform == "win32" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
