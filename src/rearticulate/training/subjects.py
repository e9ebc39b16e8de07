"""What the network is trained on: robots, furniture and creatures of random primitives."""

from __future__ import annotations

import numpy as np

from rearticulate.synth.creatures import random_creature
from rearticulate.synth.furniture import random_furniture
from rearticulate.training.pairs import Subject, make_subject
from rearticulate.training.robots import training_robots

SHARES = {"robot": 0.3, "furniture": 0.3, "creature": 0.4}  # of the subjects
RANDOM_SEEDS = 2**31


class Subjects:
    """Draws subjects; a robot keeps its stock of surface points, everything else is made when it is drawn."""

    def __init__(self) -> None:
        robots = training_robots()
        self._robots = [make_subject(robots[name], np.random.default_rng(0)) for name in sorted(robots)]

    def draw(self, rng: np.random.Generator) -> Subject:
        kind = rng.choice(list(SHARES), p=list(SHARES.values()))
        if kind == "robot":
            return self._robots[rng.integers(len(self._robots))]
        make = random_furniture if kind == "furniture" else random_creature
        return make_subject(make(int(rng.integers(RANDOM_SEEDS))), rng)
