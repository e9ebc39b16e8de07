"""Two folders swap their names in one step, where the system has that."""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path

_HERE, _SWAP = -100, 2  # AT_FDCWD; RENAME_EXCHANGE of Linux and RENAME_SWAP of macOS are both 2
_LACKING = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP}


def exchange(one: Path, other: Path) -> bool:
    """Swap two existing folders of one file system; False, and nothing done, where the system cannot."""
    swap = _system_call()
    if swap is None:
        return False
    if swap(os.fsencode(one), os.fsencode(other)) == 0:
        return True
    number = ctypes.get_errno()
    if number in _LACKING:
        return False
    raise OSError(number, os.strerror(number), str(other))


def _system_call() -> Callable[[bytes, bytes], int] | None:
    if sys.platform == "linux" and (call := getattr(_libc(), "renameat2", None)):
        return lambda one, other: call(_HERE, one, _HERE, other, _SWAP)
    if sys.platform == "darwin" and (call := getattr(_libc(), "renamex_np", None)):
        return lambda one, other: call(one, other, _SWAP)
    return None


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
