"""Pairs to train on: what they call true is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rearticulate.synth.objects import arm, cabinet
from rearticulate.training.pairs import PairConfig, make_pair, make_subject, true_matches

PLAIN = PairConfig(noisy=0.0, one_sided=0.0, hole=0.0)


def pair(config, seed=0, thing=None, n=600):
    rng = np.random.default_rng(seed)
    return make_pair(make_subject(thing or arm(), rng), n, config, rng)


def spacing(cloud):
    d = np.linalg.norm(cloud[:, None] - cloud[None], axis=-1)
    return np.median(np.where(d == 0, np.inf, d).min(axis=1))


def test_without_motion_the_match_is_the_nearest_point():
    still = replace(PLAIN, still=1.0, root=0.0)
    p = pair(still)
    d = np.linalg.norm(p.a[:, None] - p.b[None], axis=-1)
    known = p.to_b >= 0
    assert known.mean() > 0.98
    np.testing.assert_array_equal(p.to_b[known], d.argmin(axis=1)[known])
    assert d.min() > 0, "no point is in both clouds"


@pytest.mark.parametrize("seed", range(3))
def test_matches_agree_both_ways(seed):
    """A point, its match and the match of that are neighbours: the motion is undone."""
    p = pair(PLAIN, seed)
    there = p.to_b >= 0
    back = p.to_a[p.to_b[there]]
    assert (back >= 0).mean() > 0.95
    error = np.linalg.norm(p.a[there][back >= 0] - p.a[back[back >= 0]], axis=1)
    assert np.median(error) < spacing(p.a)


def test_the_step_sets_the_motion():
    def flow(low, high):
        steps = [pair(replace(PLAIN, step_deg=(low, high), root=0.0, still=0.0), s) for s in range(4)]
        return np.mean([np.linalg.norm(p.b[p.to_b[p.to_b >= 0]] - p.a[p.to_b >= 0], axis=1).mean() for p in steps])

    assert flow(2, 2) < 0.5 * flow(10, 10) < 0.5 * flow(30, 30)


def test_what_one_cloud_hides_has_no_match():
    p = pair(replace(PLAIN, hole=1.0, hole_radius=(0.4, 0.4)), 1)
    assert 0.02 < (p.to_b < 0).mean() < 0.6
    assert (p.to_a < 0).mean() < (p.to_b < 0).mean()
    shown = pair(replace(PLAIN, one_sided=1.0), 2, cabinet())
    assert shown.a.shape == shown.b.shape == (600, 3)
    assert np.isin(shown.to_b, np.arange(-1, 600)).all()


def test_pairs_repeat_for_a_seed():
    first, again, other = pair(PairConfig(), 5), pair(PairConfig(), 5), pair(PairConfig(), 6)
    np.testing.assert_array_equal(first.b, again.b)
    assert not np.array_equal(first.b, other.b)


def test_a_far_neighbour_is_none():
    cloud = np.random.default_rng(0).random((300, 3))
    moved = np.concatenate([cloud[:5], cloud[:5] + 9.0])
    np.testing.assert_array_equal(true_matches(moved, cloud), [0, 1, 2, 3, 4, -1, -1, -1, -1, -1])
