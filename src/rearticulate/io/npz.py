"""NumPy archives without pickles: objects are refused on the way in and on the way out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError, one_line
from rearticulate.io.atomic import atomic_file

_PICKLED = "pickled Python objects are refused; save plain number arrays"
_MAGIC = {".npz": (b"PK", "savez"), ".npy": (b"\x93NUMPY", "save")}


@contextmanager
def open_numpy(path: Path) -> Iterator[Any]:
    """The opened `.npz` (a mapping of arrays, each read on access) or `.npy` (a memory map) of that name.

    Whatever goes wrong in the block is one InputError that names the file.
    """
    magic, writer = _MAGIC[path.suffix.lower()]
    with read_errors(path, "NumPy file"):
        with open(path, "rb") as file:
            start = file.read(len(magic))
        if start[:1] == b"\x80":
            raise InputError(f"{path}: {_PICKLED}")
        if start != magic:
            raise InputError(f"{path}: not a {path.suffix} file, whatever its name says; write it with numpy.{writer}")
        if path.suffix.lower() == ".npy":
            yield np.load(path, mmap_mode="r", allow_pickle=False)
        else:
            with np.load(path, allow_pickle=False) as archive:
                yield archive


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


def load_arrays(path: Path) -> dict[str, Any]:
    """Every array of an `.npz`, by name."""
    with open_numpy(path) as archive:
        return {name: archive[name] for name in archive.files}


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
