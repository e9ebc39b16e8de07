"""Random creatures: trees of connected lumpy parts; primitives with the areas that formulas give."""

from __future__ import annotations

import numpy as np
import pytest

from random_objects import assert_connected, assert_every_joint_moves, assert_tree, extent, same_bits
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.synth.creatures import MIRROR, Body, Bone, random_creature
from rearticulate.synth.flesh import flesh
from rearticulate.synth.primitives import arc, ball, bar, block, ring, tube, turned
from rearticulate.synth.surfaces import areas, box

SEEDS = range(40)


@pytest.mark.parametrize("seed", SEEDS)
def test_creatures_hang_together_and_move(seed):
    thing = random_creature(seed)
    assert 3 <= thing.n_parts <= 15 and 0.1 < extent(thing).max() < 3
    assert_tree(thing)
    assert_connected(thing, seed)
    assert_every_joint_moves(thing)


def test_seeds_reproduce_bit_for_bit_and_differ():
    assert all(same_bits(random_creature(seed), random_creature(seed)) for seed in range(10))
    assert not any(same_bits(random_creature(seed), random_creature(seed + 1)) for seed in range(10))


def test_there_are_all_kinds_of_trees_and_joints():
    things = [random_creature(seed) for seed in SEEDS]
    kinds = [kind for thing in things for kind in thing.joint_type[1:]]
    assert kinds.count("prismatic") > 10 and kinds.count("revolute") > 100
    assert any(np.isinf(thing.limits).any() for thing in things)
    branches = [np.bincount(thing.parent[1:]).max() for thing in things]
    assert min(branches) == 1 and max(branches) >= 5
    assert len({thing.n_parts for thing in things}) >= 8


def test_a_mirrored_bone_moves_as_its_mirror_image():
    rng = np.random.default_rng(0)
    zero = np.zeros(3)
    body = Body(zero, np.array([0, 0, 0.5]), 0.1, rng)
    for kind in ("revolute", "prismatic"):
        start, end, axis = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
        surface = flesh(start, end, 0.1, rng)
        bone = Bone(surface, surface[:0], start, end, kind, axis / np.linalg.norm(axis), start, (-1.0, 1.0))
        body.hang([bone])
        body.hang([bone.moved(MIRROR)])
    thing = body.build()
    T = thing.forward(np.array([0.0, 0.7, 0.7, -0.4, -0.4]))
    for left in (1, 3):
        moved = [transform(T[p], thing.surfaces[p].reshape(-1, 3)) for p in (left, left + 1)]
        np.testing.assert_allclose(moved[1], moved[0] * (-1, 1, 1), atol=1e-12)


def test_no_part_looks_the_same_after_a_turn_about_its_own_line():
    rng = np.random.default_rng(1)
    for _ in range(20):
        surface = flesh(np.zeros(3), np.array([0, 0, 0.4]), 0.05, rng)
        weight = areas(surface)
        middle = (surface.mean(axis=1) * weight[:, None]).sum(axis=0) / weight.sum()
        turned_middle = transform(exp_se3(np.array([0, 0, np.pi, 0, 0, 0])), middle[None])[0]
        assert np.linalg.norm(turned_middle - middle) > 1e-4


def test_areas_of_primitives_are_those_of_the_formulas():
    pi = np.pi
    assert areas(block((1, 2, 3), (4, 5, 6))).sum() == pytest.approx(22)
    np.testing.assert_allclose(block((1, 2, 3), (4, 5, 6)).reshape(-1, 3).max(axis=0), [4.5, 6, 7.5])
    assert areas(bar((0, 0, 0), (0, 1, 0), (0.2, 0.1), sides=4)).sum() == pytest.approx(2 * 0.08 + 0.6 * 2)
    assert areas(bar((0, 0, 0), (3, 0, 4), 0.5, sides=96)).sum() == pytest.approx(pi * 5 + pi / 2, rel=2e-3)
    cone = turned([(0, 1), (1, 0)], (0, 0, 0), (0, 0, 2), sides=96)
    assert areas(cone).sum() == pytest.approx(pi + pi * np.sqrt(5), rel=2e-3)
    assert areas(ball(0.5, (1, 2, 3))).sum() == pytest.approx(pi, rel=0.04)
    assert areas(ring(1, 0.1, (0, 0, 0), (1, 1, 1))).sum() == pytest.approx(4 * pi**2 * 0.1, rel=0.06)


def test_primitives_are_where_they_are_put():
    a, b = np.array([0.3, -0.2, 0.5]), np.array([-0.4, 0.1, 1.0])
    bent = tube(arc(a, (0.5, 0.5, 0.5), b), 0.01).reshape(-1, 3)
    for end in (a, b, np.array([0.5, 0.5, 0.5])):
        assert np.linalg.norm(bent - end, axis=1).min() < 0.011
    flat = bar(a, b, (0.2, 0.01), sides=4, across=(0, 0, 1)).reshape(-1, 3)
    u = np.cross(b - a, (0, 0, 1))
    assert np.ptp(flat @ (u / np.linalg.norm(u))) == pytest.approx(0.02)
    np.testing.assert_allclose(ring(1, 0.1, a, (0, 0, 2)).reshape(-1, 3)[:, 2].max(), a[2] + 0.1, atol=0.01)


def test_solids_are_closed():
    for solid in (box((1, 1, 1)), block((1, 1, 1), (0, 0, 0)), ball(1, (0, 0, 0)), ring(1, 0.2, (0, 0, 0), (0, 0, 1))):
        normal = np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0])
        np.testing.assert_allclose(normal.sum(axis=0), 0, atol=1e-12)
        assert np.einsum("nd,nd->", normal, solid.mean(axis=1)) > 0  # outwards
