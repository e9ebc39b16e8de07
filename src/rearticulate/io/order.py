"""The order of frames by their names.

Numbers in names count as whole numbers: frame2 comes before frame10. Where the last number of some names has decimals
(1711111112.33.ply), that number is a time and counts as one: .33 comes before .5. Not so where decimals of different
lengths end in a zero (0.5 beside 0.10), which times do not: there someone counted.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import Any, Literal

from rearticulate.errors import InputWarning

_TIME = re.compile(r"(.*?)(\d+)(?:\.(\d+))?(\D*)", re.DOTALL)


def in_order(names: Iterable[str], suffix: str = "") -> list[str]:
    """Names in the order of their frames (see the module). suffix: what all end with, no part of the name.

    An InputWarning where times among whole numbers would be in another order.
    """
    names = list(names)
    by_number = natural_order(names)
    if ordered_by(names, suffix) == "number":
        return by_number
    by_time = sorted(names, key=lambda name: (_by_time(_stem(name, suffix)), name))
    if by_time != by_number:
        first = next(f for f, (a, b) in enumerate(zip(by_time, by_number, strict=True)) if a != b)
        text = " before ".join(by_time[first : first + 2])
        text = f"frames in the order of times: {text}; were they counted, it would be another"
        warnings.warn(text, InputWarning, stacklevel=2)
    return by_time


def describe_order(names: Sequence[str]) -> str:
    """ "a1.ply, a2.ply ... a9.ply (by number)"."""
    suffixes = {PurePath(name).suffix for name in names}
    suffix = suffixes.pop().lower() if len(suffixes) == 1 else ""
    few = ", ".join(names) if len(names) <= 4 else f"{names[0]}, {names[1]} ... {names[-1]}"
    return f"{few} (by {ordered_by(names, suffix)})"


def ordered_by(names: Sequence[str], suffix: str = "") -> Literal["number", "time"]:
    """Whether the last number of the names is a time."""
    found = [_TIME.fullmatch(_stem(name, suffix)) for name in names]
    if not all(found) or len({match[4] for match in found if match}) > 1:
        return "number"
    decimals = {match[3] for match in found if match and match[3]}
    counted = len({len(d) for d in decimals}) > 1 and any(len(d) > 1 and d.endswith("0") for d in decimals)
    return "time" if decimals and not counted else "number"


def natural_order(names: Iterable[str]) -> list[str]:
    """Names sorted as people count, every number a whole number."""
    return sorted(names, key=lambda name: (_by_number(name), name))


def _stem(name: str, suffix: str) -> str:
    return name[: -len(suffix)] if suffix and name.lower().endswith(suffix) else name


def _by_number(name: str) -> list[tuple[Any, ...]]:
    return [_chunk(text) for text in re.split(r"(\d+)", name)]


def _by_time(name: str) -> list[tuple[Any, ...]]:
    match = _TIME.fullmatch(name)
    assert match is not None  # `ordered_by` has seen to it
    head, whole, decimals, _ = match.groups()
    return [*_by_number(head), _chunk(whole), (0, 0, (decimals or "").rstrip("0"))]


def _chunk(text: str) -> tuple[int, int, str]:
    """Words before numbers; numbers by value, of any length."""
    if not text.isdecimal():
        return (-1, 0, text.lower())
    digits = text.lstrip("0")
    return (0, len(digits), digits)
