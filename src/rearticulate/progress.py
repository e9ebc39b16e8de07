"""How far a stage is: told from within its loops, as a share done of it that never falls."""

from __future__ import annotations

from collections.abc import Callable, Iterator

Told = Callable[[float], None]


def untold(done: float) -> None:
    """Nobody listens."""


def steps(told: Told, count: int) -> Iterator[Told]:
    """What each of `count` steps tells its own shares 0 to 1 to."""
    for i in range(count):
        yield lambda done, i=i: told((i + done) / count)


def rounds(told: Told) -> Iterator[None]:
    """Rounds of which nobody knows how many there will be: 1/2, 2/3, 3/4, ... are done."""
    done = 0
    while True:
        yield
        done += 1
        told(done / (done + 1))
