"""A lock that dies with its process: a file which is there, and locked by the system, only while it is held."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

ROOM = 4096  # bytes in the file: a full disk is noticed now

if sys.platform == "win32":
    import msvcrt

    def _try(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _try(descriptor: int) -> None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):  # a file system without locks
                raise


class Busy(Exception):
    """Somebody else holds the lock."""


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock file `path`. Raises Busy at once where it is held already, OSError where it cannot be written."""
    descriptor = _take(path)
    try:
        yield
    finally:
        if sys.platform == "win32":  # removes no open file
            os.close(descriptor)
        with suppress(OSError):
            path.unlink()
        if sys.platform != "win32":
            os.close(descriptor)


def _take(path: Path) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0))
        try:
            _claim(descriptor)
            if _names(path, descriptor):
                _fill(path, descriptor)
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # its holder removed it meanwhile


def _claim(descriptor: int) -> None:
    try:
        _try(descriptor)
    except (BlockingIOError, PermissionError) as error:
        raise Busy from error


def _names(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _fill(path: Path, descriptor: int) -> None:
    try:
        os.write(descriptor, bytes(ROOM))
    except OSError:
        with suppress(OSError):
            path.unlink()
        raise
