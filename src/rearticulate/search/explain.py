"""Bodies that explain the clouds: labels, motions, merges and splits in turn, as long as the score falls."""

from __future__ import annotations

from rearticulate.config import FitConfig
from rearticulate.observe.frames import Frames
from rearticulate.parts.bodies import Bodies, explanation, settled, without_crumbs
from rearticulate.parts.ownership import exchange, relabel
from rearticulate.progress import Told, steps, untold
from rearticulate.search.moves.merge import merge_bodies
from rearticulate.search.moves.split import split_bodies
from rearticulate.search.moves.sweep import sweep_bodies

TURNS = 4  # at most
ROUGH, FINE = (0.4,), (0.3,)  # robust scales of registrations, in spacings
WORTH = 2e-3  # share of the score that a turn must bring if there is to be another one


def explain(
    frames: Frames, canonical: int, bodies: Bodies, config: FitConfig, tried: Bodies = (), told: Told = untold
) -> Bodies:
    """The bodies of the lowest score after a few turns. What was split must find its place in the next turn, and at the
    end any two are asked once more whether they are one. tried: bodies that need not be changed again."""
    best, lowest = bodies, None
    *turns, last = steps(told, TURNS + 1)
    for left, turn in zip(reversed(range(TURNS)), turns, strict=True):
        points, layers, merges = steps(turn, 3)
        bodies = relabel(frames, settled(frames, canonical, bodies, ROUGH + FINE), told=points)
        if config.uses("exchange"):
            bodies = exchange(frames, bodies, tried, layers)
        bodies = settled(frames, canonical, without_crumbs(frames, bodies), FINE)
        if config.uses("sweep"):
            bodies = sweep_bodies(frames, canonical, bodies, tried)
        bodies = merge_bodies(frames, canonical, bodies, tried, merges)
        new = explanation(frames, bodies)
        gain = -new.over(lowest)
        if gain > 0:
            best, lowest = bodies, new
        before, tried = tried, bodies
        if config.uses("split") and left:
            bodies = split_bodies(frames, canonical, bodies, before, config.uses("slides"))
        if len(bodies) > len(tried):
            lowest = None
        elif gain < WORTH * new.score:
            break
    return merge_bodies(frames, canonical, best, told=last)
