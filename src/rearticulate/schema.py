"""What an array may be: its kind, its shape in the letters of the records (F frames, N points, P parts), its range.

Loaders and the constructors of the records check with the same schema. Every failure is an InputError of one line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import FAR
from rearticulate.errors import FitError, InputError
from rearticulate.geometry.se3 import is_rigid

Array = NDArray[Any]
_KINDS = {"real": ("fiu", np.float64, "finite numbers"), "whole": ("iu", np.int64, "whole numbers")}


@dataclass(frozen=True)
class Field:
    """One array. shape: a size or a letter each axis ("P 3"); low, below: of every value, `below` may be a letter."""

    kind: Literal["real", "whole"]
    shape: str
    low: float | None = None
    below: str | None = None
    rigid: bool = False


def real(shape: str, low: float | None = None) -> Field:
    """float64, finite and smaller than `FAR`."""
    return Field("real", shape, low)


def whole(shape: str, low: int | None = None, below: str | None = None) -> Field:
    """int64."""
    return Field("whole", shape, low, below)


def rigid(shape: str) -> Field:
    """Rigid motions; the last two axes are 4 x 4."""
    return Field("real", shape, rigid=True)


def conform(values: Mapping[str, Any], schema: Mapping[str, Field], **sizes: int) -> dict[str, Array]:
    """The arrays of a schema as float64 and int64, checked; `sizes` by letter, those that are known beforehand."""
    known, out = dict(sizes), {}
    for name, field in schema.items():
        if name not in values:
            raise InputError(f"{name!r} is missing")
        out[name] = as_array(name, values[name], field, known)
    return out


def conform_fields(record: Any, schema: Mapping[str, Field], **sizes: int) -> None:
    """The same for the fields of a frozen dataclass, in place."""
    for name, array in conform(vars(record), schema, **sizes).items():
        object.__setattr__(record, name, array)


def as_array(name: str, value: Any, field: Field, sizes: dict[str, int]) -> Array:
    """One array of a schema. sizes: by letter; letters that are new are added."""
    kinds, dtype, what = _KINDS[field.kind]
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of {what}") from error
    if array.size and array.dtype.kind not in kinds:
        raise InputError(f"{name} must hold {what}, not {array.dtype}")
    _check_shape(name, array, field, sizes)
    _check_range(name, array, field, sizes)
    array = array.astype(dtype, copy=False)
    if field.rigid and not (sound := is_rigid(array)).all():
        raise InputError(f"{name} must hold rigid motions, that of {_first(~sound)} is none")
    return array


def finite(what: str, array: Array) -> Array:
    """The same array; a FitError where a number of it is not finite, so that none such is ever written."""
    if not np.isfinite(array).all():
        raise FitError(f"{what}: some of the numbers to be written are not finite")
    return array


def _check_shape(name: str, array: Array, field: Field, sizes: dict[str, int]) -> None:
    letters = field.shape.split()
    if array.ndim == len(letters):
        for letter, size in zip(letters, array.shape, strict=True):
            if not letter.isdecimal():
                sizes.setdefault(letter, size)
    wanted = tuple(int(letter) if letter.isdecimal() else sizes.get(letter, letter) for letter in letters)
    if array.shape != wanted:
        text = f"({', '.join(map(str, wanted))}{',' if len(wanted) == 1 else ''})"
        raise InputError(f"{name} has shape {array.shape}, expected {text}")


def _check_range(name: str, array: Array, field: Field, sizes: dict[str, int]) -> None:
    if field.kind == "real":
        with np.errstate(invalid="ignore", over="ignore"):
            wrong = ~(np.abs(array) < FAR)
        if wrong.any():
            raise InputError(f"{name} must hold finite numbers, not {array[wrong][0]} as in {_first(wrong)}")
    high = None if field.below is None else sizes[field.below]
    wrong = np.zeros(array.shape, dtype=bool)
    if field.low is not None:
        wrong |= array < field.low
    if high is not None:
        wrong |= array >= high
    if wrong.any():
        bounds = f"{field.low} at least" if high is None else f"from {field.low} to {high - 1}"
        raise InputError(f"{name} must be {bounds}, not {array[wrong][0]} as in {_first(wrong)}")


def _first(wrong: Array | np.bool_) -> str:
    place = np.argwhere(wrong)[0].tolist() if wrong.ndim else []
    return f"row {place[0]}" if len(place) == 1 else f"place {place}"
