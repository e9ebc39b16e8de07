"""NumPy archives without pickles: objects are refused on the way in and on the way out.

An array is unpacked only where its header agrees with the size of the file, or with that of its member of the archive,
and the budget allows it (see `io.budget`).
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from rearticulate.errors import InputError, one_line
from rearticulate.io.atomic import atomic_file
from rearticulate.io.budget import MAX_BYTES, check_file, check_promise, check_unpacked

_PICKLED = "pickled Python objects are refused; save plain number arrays"
_MAGIC = {".npz": (b"PK", "savez"), ".npy": (b"\x93NUMPY", "save")}
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_MAX_MEMBERS = 10_000


@dataclass(frozen=True)
class ArrayHeader:
    """shape and dtype of a stored array; size of the header itself in bytes."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    offset: int

    @property
    def n_bytes(self) -> int:
        """Of header and numbers."""
        return self.offset + math.prod(self.shape) * self.dtype.itemsize


def read_array_header(file: IO[bytes]) -> ArrayHeader:
    """The header of an `.npy` at the start of `file`. Raises ValueError where it is none."""
    read = _HEADERS.get(np.lib.format.read_magic(file))
    if read is None:
        raise ValueError("arrays with such a header are not read; save plain number arrays")
    shape, _, dtype = read(file)
    if dtype.hasobject:
        raise ValueError("Python objects")
    if any(n < 0 for n in shape):
        raise ValueError(f"a shape of {shape}")
    return ArrayHeader(shape, dtype, file.tell())


class Archive:
    """The arrays of an `.npz` by name, each unpacked on access.

    files: their names. Raises InputError where an array would exceed what is left of `max_bytes`, ValueError where it
    is not what its header says.
    """

    def __init__(self, path: Path, archive: zipfile.ZipFile, max_bytes: int) -> None:
        members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
        self.files = [member.filename[: -len(".npy")] for member in members]
        if not all(name.isprintable() for name in self.files):
            raise ValueError("an array whose name cannot be printed")
        if len(members) > _MAX_MEMBERS:
            raise ValueError(f"{len(members)} arrays, more than {_MAX_MEMBERS}")
        if len(set(self.files)) < len(members):
            raise ValueError("two arrays of one name")
        self._path, self._archive, self._left = path, archive, max_bytes
        self._members = dict(zip(self.files, members, strict=True))

    def header(self, name: str) -> ArrayHeader:
        """Shape and type of an array that is not unpacked for it."""
        with self._archive.open(self._members[name]) as file:
            return read_array_header(file)

    def __getitem__(self, name: str) -> np.ndarray:
        member = self._members[name]
        check_promise(self.header(name).n_bytes, member.file_size, f"bytes of {name}")
        check_unpacked(f"{self._path}: {name}", member.file_size, member.compress_size, self._left)
        self._left -= member.file_size
        with self._archive.open(member) as file:
            return np.lib.format.read_array(file, allow_pickle=False)


@contextmanager
def open_numpy(path: Path, max_bytes: int = MAX_BYTES) -> Iterator[Any]:
    """The `Archive` in an `.npz`, or the array in an `.npy` (a memory map).

    Whatever goes wrong in the block is one InputError that names the file.
    """
    magic, writer = _MAGIC[path.suffix.lower()]
    with read_errors(path, "NumPy file"):
        n_bytes = check_file(path, max_bytes)
        with open(path, "rb") as file:
            start = file.read(len(magic))
            if start[:1] == b"\x80":
                raise InputError(f"{path}: {_PICKLED}")
            if start != magic:
                text = f"not a {path.suffix} file, whatever its name says; write it with numpy.{writer}"
                raise InputError(f"{path}: {text}")
            file.seek(0)
            if path.suffix.lower() == ".npy":
                check_promise(read_array_header(file).n_bytes, n_bytes, "bytes")
                yield np.load(path, mmap_mode="r", allow_pickle=False)
            else:
                with zipfile.ZipFile(file) as archive:
                    yield Archive(path, archive, max_bytes)


@contextmanager
def read_errors(path: Path, what: str) -> Iterator[None]:
    """Turn what a reader of untrusted bytes may raise (anything) into one line that names the file."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: does not fit in memory; give fewer points a frame") from error
    except Exception as error:
        if "allow_pickle" in str(error) or "Python objects" in str(error):
            raise InputError(f"{path}: {_PICKLED}") from error
        raise InputError(f"{path}: damaged or not a {what} ({one_line(error)})") from error


def load_arrays(path: Path, max_bytes: int = MAX_BYTES) -> dict[str, Any]:
    """Every array of an `.npz`, by name."""
    return load_some_arrays(path, lambda name: True, max_bytes)


def load_some_arrays(path: Path, wanted: Callable[[str], bool], max_bytes: int = MAX_BYTES) -> dict[str, Any]:
    """Those whose names are wanted."""
    with open_numpy(path, max_bytes) as archive:
        return {name: archive[name] for name in archive.files if wanted(name)}


def write_arrays(path: Path, arrays: Mapping[str, Any], compress: bool = False) -> None:
    """Write an `.npz` that holds plain arrays only."""
    plain = {name: np.asarray(value) for name, value in arrays.items()}
    pickled = [name for name, value in plain.items() if value.dtype.hasobject]
    if pickled:
        raise TypeError(f"arrays of objects are not saved: {', '.join(pickled)}")
    with open(path, "wb") as file:
        (np.savez_compressed if compress else np.savez)(file, **plain)  # pyright: ignore[reportArgumentType]


def save_arrays(path: Path, arrays: Mapping[str, Any], compress: bool = False) -> None:
    """`write_arrays`, whole or not at all."""
    with atomic_file(path) as partial:
        write_arrays(partial, arrays, compress)
