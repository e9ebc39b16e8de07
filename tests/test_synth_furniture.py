"""Random household things: trees of connected parts, varied, and the same for the same seed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from random_objects import assert_connected, assert_every_joint_moves, assert_tree, extent, same_bits
from rearticulate.geometry.se3 import transform
from rearticulate.synth.furniture import MAKERS, random_furniture
from rearticulate.synth.furniture.cabinets import case

SEEDS = range(80)


@pytest.mark.parametrize("make", dict.fromkeys(MAKERS), ids=lambda make: make.__name__)
def test_things_hang_together_and_move(make):
    for seed in range(6):
        thing = make(np.random.default_rng(seed))
        assert 2 <= thing.n_parts <= 8 and 0.1 < extent(thing).max() < 2.4
        assert_tree(thing)
        assert_connected(thing, seed)
        assert_every_joint_moves(thing)


def test_seeds_reproduce_bit_for_bit_and_differ():
    assert all(same_bits(random_furniture(seed), random_furniture(seed)) for seed in range(20))
    assert not any(same_bits(random_furniture(seed), random_furniture(seed + 1)) for seed in range(20))


def test_there_are_all_kinds_of_parts_and_joints():
    things = [random_furniture(seed) for seed in SEEDS]
    names = Counter(name for thing in things for name in thing.names)
    assert {"door", "drawer", "lid", "leaf", "handle", "knob", "head"} <= set(names)
    kinds = Counter(kind for thing in things for kind in thing.joint_type[1:])
    assert kinds["revolute"] > 50 and kinds["prismatic"] > 20
    assert len({thing.n_parts for thing in things}) >= 6


def test_doors_and_drawers_open_to_the_front():
    for seed in range(12):
        thing = case(np.random.default_rng(seed))
        T = thing.forward(np.full(thing.n_parts, 0.05))  # rad or m
        for p in range(1, thing.n_parts):
            middle = thing.surfaces[p].reshape(-1, 3).mean(axis=0)
            opened = transform(T[p], middle[None])[0]
            if thing.names[p] == "sliding_door":
                assert opened[1] == pytest.approx(middle[1]) and abs(opened[0] - middle[0]) == pytest.approx(0.05)
            else:
                assert opened[1] < middle[1] - 0.001
