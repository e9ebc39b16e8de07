"""What makes names, trees and joints those of a kinematic model, whoever made them. Every failure is an InputError."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import shown
from rearticulate.errors import InputError

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

LONGEST_NAME = 200
_UNIT = 1e-6  # what the length of an axis may differ from 1


def check_names(what: str, names: Sequence[Any], count: int) -> None:
    """So many, each different, printable (no control characters, no lone surrogates), without spaces around it."""
    if len(names) != count:
        raise InputError(f"there are {len(names)} names of {what}s, expected {count}")
    for name in names:
        if not isinstance(name, str) or not name or not name.isprintable() or name != name.strip():
            raise InputError(f"the name of a {what} must be printable text, not {shown(name)}")
        if len(name) > LONGEST_NAME:
            raise InputError(f"the name of a {what} has {len(name)} letters, {LONGEST_NAME} at most: {shown(name)}")
    twins = [name for name in names if list(names).count(name) > 1] if len(set(names)) < len(names) else []
    if twins:
        raise InputError(f"two {what}s have one name, {twins[0]!r}: names must be unique")


def check_tree(parent: IntArray, in_order: bool = True) -> None:
    """One root, parent -1, and no cycles; with `in_order` the root is first and parents come before their children."""
    roots = np.flatnonzero(parent < 0)
    if len(roots) != 1 or parent[roots[0]] != -1:
        raise InputError(f"a tree has one root, whose parent is -1; this one has {len(roots)} of {len(parent)} parts")
    if in_order and (roots[0] != 0 or (parent >= np.arange(len(parent))).any()):
        raise InputError(f"the root must be part 0 and parents must come before their children, not {parent.tolist()}")
    up = np.where(parent < 0, np.arange(len(parent)), parent)
    for _ in range(len(parent).bit_length()):  # twice as far up each time
        up = up[up]
    if (up != roots[0]).any():
        raise InputError(f"the parents must be a tree without cycles, not {parent.tolist()}")


def check_axes(kinds: Sequence[str], axis: Array) -> None:
    """(P, 3): of length 1 where the joint has one (revolute, prismatic), of length 1 or 0 where it is fixed, else 0."""
    length = np.linalg.norm(axis, axis=1)
    for j, kind in enumerate(kinds):
        unit, none = abs(length[j] - 1.0) <= _UNIT, length[j] == 0.0
        if not (unit if kind in ("revolute", "prismatic") else none or (unit and kind == "fixed")):
            wanted = "1" if kind in ("revolute", "prismatic") else "0"
            raise InputError(f"the axis of part {j}, {kind or 'root'}, must have length {wanted}, not {length[j]:.9g}")


def check_limits(kinds: Sequence[str], limits: Array) -> None:
    """(P, 2): the lower one first, those of an angle (spherical) not negative."""
    for j, kind in enumerate(kinds):
        low, high = limits[j]
        if low > high or (kind == "spherical" and low < 0):
            wanted = "in order" + (" and not negative" if kind == "spherical" else "")
            raise InputError(f"the limits of part {j} must be {wanted}, not {low:g} to {high:g}")


def check_kinds(kinds: Sequence[Any], known: Sequence[str], parent: IntArray, at_root: str) -> None:
    """One joint type a part, all of them known; that of the root, and no other one, is `at_root`."""
    if len(kinds) != len(parent):
        raise InputError(f"there are {len(kinds)} joint types, expected one of each of {len(parent)} parts")
    for j, kind in enumerate(kinds):
        if not isinstance(kind, str) or kind not in known:
            raise InputError(f"the joint type {shown(kind)} of part {j} is not known; there are {', '.join(known)}")
        if (kind == at_root) != (parent[j] < 0):
            raise InputError(f"part {j} has the joint type {kind!r}: only the root is {at_root!r}")
