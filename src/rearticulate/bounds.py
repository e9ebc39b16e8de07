"""What a number may be, said once, in its type: `iterations: Annotated[int, Bounds(2)] = 30`.

`Settings` are dataclasses whose fields are checked when they are made, `checked` functions have their arguments checked
when they are called. Both raise an InputError of one line.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from types import UnionType
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from rearticulate.errors import InputError

FAR = 1e30  # no coordinate in any unit is as large, and the tenth power of a smaller one is still a number

_P = ParamSpec("_P")
_R = TypeVar("_R")


@dataclass(frozen=True)
class Bounds:
    """A number, or the length of a tuple, from `low` to `high`; `open`: beyond `low`, not at it."""

    low: float = -FAR
    high: float = FAR
    open: bool = False

    def hold(self, value: Any) -> bool:
        return (self.low < value if self.open else self.low <= value) and value <= self.high

    def __str__(self) -> str:
        least = f"above {self.low:g}" if self.open else f"of {self.low:g} at least"
        parts = [least] if self.low > -FAR else []
        return " and ".join([*parts, *([f"of {self.high:g} at most"] if self.high < FAR else [])])


Finite = Annotated[float, Bounds()]
Positive = Annotated[float, Bounds(0, open=True)]
NotNegative = Annotated[float, Bounds(0)]
Share = Annotated[float, Bounds(0, 1)]
Count = Annotated[int, Bounds(1, 10**9)]
CountOrZero = Annotated[int, Bounds(0, 10**9)]
Seed = Annotated[int, Bounds(0, 2**63 - 1)]


class Settings:
    """Base of dataclasses whose fields hold what their types say; whole numbers and floats become int and float."""

    def __post_init__(self) -> None:
        hints = _hints(type(self))
        for field in fields(self):  # type: ignore[arg-type]
            value = conform(field.name, getattr(self, field.name), hints[field.name])
            object.__setattr__(self, field.name, value)


def checked(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The function, with the arguments checked whose types are bounded numbers or choices."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        hints, bound = _hints(function), signature.bind(*args, **kwargs)
        for name, value in bound.arguments.items():
            if _is_bounded(hints.get(name)):
                bound.arguments[name] = conform(name, value, hints[name])
        return function(*bound.args, **bound.kwargs)

    return call


def conform(name: str, value: Any, hint: Any) -> Any:
    """`value` as the type `hint` says it: a bounded number, bool, str, Literal, dataclass, a tuple or None besides."""
    bounds = next((b for b in getattr(hint, "__metadata__", ()) if isinstance(b, Bounds)), None)
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if get_origin(kind) in (Union, UnionType):
        first, *_ = [other for other in get_args(kind) if other is not type(None)]
        return None if value is None else conform(name, value, first)
    if get_origin(kind) is tuple:
        return _tuple(name, value, get_args(kind), bounds or Bounds(1))
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise InputError(f"{name} must be one of {', '.join(map(str, get_args(kind)))}, not {shown(value)}")
        return value
    if kind in (int, float):
        return _number(name, value, kind, bounds or Bounds())
    if isinstance(kind, type) and not isinstance(value, kind):
        wanted = "true or false" if kind is bool else "text" if kind is str else f"a {kind.__name__}"
        raise InputError(f"{name} must be {wanted}, not {shown(value)}")
    return value


def shown(value: Any) -> str:
    """A wrong value in a message, on one line of bearable length."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _number(name: str, value: Any, kind: type[int | float], bounds: Bounds) -> float:
    real = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not real or not math.isfinite(value) or not bounds.hold(value) or (kind is int and value % 1 != 0):
        what = " ".join(filter(None, ["a whole number" if kind is int else "a number", str(bounds)]))
        raise InputError(f"{name} must be {what}, not {shown(value)}")
    return kind(value)


def _tuple(name: str, value: Any, items: tuple[Any, ...], length: Bounds) -> tuple[Any, ...]:
    any_length = items[-1] is Ellipsis
    length = length if any_length else Bounds(len(items), len(items))
    if not isinstance(value, (tuple, list)) or not length.hold(len(value)):
        raise InputError(f"{name} must be {'a list of' if any_length else len(items)} values, not {shown(value)}")
    return tuple(conform(name, each, items[0]) for each in value)


@functools.cache
def _hints(thing: Any) -> dict[str, Any]:
    return get_type_hints(thing, include_extras=True)


def _is_bounded(hint: Any) -> bool:
    if get_origin(hint) in (Union, UnionType):
        return any(_is_bounded(kind) for kind in get_args(hint))
    return get_origin(hint) in (Annotated, Literal) or (isinstance(hint, type) and is_dataclass(hint))
