"""What the dynamics gate asks of a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

Pair = tuple[str, str]  # links, in alphabetical order


class Engine(Protocol):
    """A robot with a fixed root, loaded into a simulator."""

    def contacts(self, q: Mapping[str, float]) -> dict[Pair, float]:
        """How deep links are in each other at joint values (by the names of the joints, 0 for the others), m."""
        ...

    def run(self, seconds: float, *, gravity: bool, driven: bool) -> float:
        """From the rest pose: the largest change of any joint value at any time, rad or m. driven: by the drives that
        the file has, told to stay; else no force acts."""
        ...


def deepest(found: dict[Pair, float], a: str, b: str, depth: float) -> None:
    """Note a contact where it is the deepest of a pair."""
    pair = (min(a, b), max(a, b))
    if depth > found.get(pair, 0.0):
        found[pair] = depth
