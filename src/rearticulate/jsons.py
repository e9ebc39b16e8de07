"""JSON files from users: one line says what is wrong with one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import FAR
from rearticulate.errors import InputError, one_line

LARGEST = 64 * 2**20  # bytes of a file


def read_json(path: Path, absent: str = "") -> Any:
    """The value in a file; `absent` is the message where there is none. Raises InputError.

    Stricter than Python's own reader: no NaN or Infinity, no key twice in one object, no half of a character.
    """
    try:
        return _parsed(_content(path))
    except FileNotFoundError as error:
        raise InputError(absent or f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: damaged, not valid JSON (it is nested too deeply)") from error
    except ValueError as error:
        raise InputError(f"{path}: damaged, not valid JSON ({one_line(error)})") from error


def json_array(value: Any, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """Nested lists of numbers as an array. Raises InputError where they have another shape or are no finite numbers."""
    flat = _leaves(value, shape)
    if flat is None or not all(type(x) in (int, float) and abs(x) < FAR and abs(float(x)) < FAR for x in flat):
        wanted = "a finite number" if not shape else f"finite numbers of shape {' x '.join(map(str, shape))}"
        raise InputError(f"{what} must be {wanted}")
    return np.array(flat, dtype=np.float64).reshape(shape)


def _leaves(value: Any, shape: tuple[int, ...]) -> list[Any] | None:
    """All that is in lists nested to this shape; None where they have another."""
    if not shape:
        return [value]
    if not isinstance(value, list) or len(value) != shape[0]:
        return None
    rows = [_leaves(row, shape[1:]) for row in value]
    return None if None in rows else [leaf for row in rows for leaf in row or []]


def _content(path: Path) -> str:
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: not a file")
    with open(path, "rb") as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise InputError(f"{path}: larger than {LARGEST // 2**20} MiB, which none of our files is")
    return content.decode("utf-8")


def _parsed(text: str) -> Any:
    value = json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse)
    json.dumps(value, ensure_ascii=False).encode("utf-8")  # fails on half a surrogate pair, wherever it is
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {next(key for key in keys if keys.count(key) > 1)!r} is there twice")
    return record


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not a number that JSON has")
