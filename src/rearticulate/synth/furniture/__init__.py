"""Household things at random: cases with doors and drawers, lids, chains of arms, wheels, knobs and crossed levers.

Coordinates: x to the right, y to the back, z up; most things stand on z = 0 and open towards -y.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rearticulate.synth.articulated import ArticulatedObject
from rearticulate.synth.furniture.arms import fan, faucet, lamp, telescope
from rearticulate.synth.furniture.cabinets import case, oven
from rearticulate.synth.furniture.frames import cart, doorway, folding_chair, swivel_chair
from rearticulate.synth.furniture.levers import controls, knife, pliers
from rearticulate.synth.furniture.lids import laptop, vessel

MAKERS: tuple[Callable[[np.random.Generator], ArticulatedObject], ...] = (
    case, case, case, case, oven, vessel, vessel, laptop, lamp, faucet, fan, telescope,
    pliers, knife, controls, cart, doorway, folding_chair, swivel_chair,
)  # fmt: skip


def random_furniture(seed: int) -> ArticulatedObject:
    """A random household thing of 2 to 8 parts, 0.15 to 2.5 m large in a random posture."""
    rng = np.random.default_rng(seed)
    return MAKERS[rng.integers(len(MAKERS))](rng)
