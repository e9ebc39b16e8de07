"""The part at rest that a body of revolution hides, and connected regions."""

from __future__ import annotations

import numpy as np

from oracle import in_spacings
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.observe.frames import make_frames
from rearticulate.parts.relaxed import Relaxed
from rearticulate.parts.rest import largest_region, part_at_rest


def grid(n, shift=0.0):
    cells = np.stack(np.meshgrid(np.arange(n), np.arange(n), [0.0], indexing="ij"), -1)
    return cells.reshape(-1, 3) + np.array([shift, 0, 0])


def test_the_largest_region_is_connected_and_inside():
    points = np.concatenate([grid(6), grid(8, 30.0)])
    near = nearest(search_tree(points), points, k=9)[1][:, 1:]
    inside = np.ones(100, dtype=bool)
    assert np.array_equal(largest_region(points, near, inside), points[:, 0] > 20)
    inside[points[:, 0] > 33.5] = False
    assert np.array_equal(largest_region(points, near, inside), points[:, 0] < 20)
    assert not largest_region(points, near, np.zeros(100, dtype=bool)).any()


def post_and_arm(turn, frames=4, seed=0):
    """A post, round about z, and an arm that turns by `turn` a frame about it; one part that turns with the arm."""
    rng = np.random.default_rng(seed)
    clouds = []
    for f in range(frames):
        angle = rng.uniform(0, 2 * np.pi, 900)
        post = np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), rng.uniform(0, 0.5, 900)], axis=1)
        arm = rng.uniform([0.1, -0.05, 0.5], [0.6, 0.05, 0.5], (500, 3))
        clouds.append(np.concatenate([post, transform(exp_se3(np.array([0, 0, turn * f, 0, 0, 0])), arm)]))
    seen = make_frames(clouds)
    T = in_spacings(seen, exp_se3(np.outer(np.arange(frames), [0, 0, turn, 0, 0, 0]))[:, None])
    post = np.tile(np.arange(1400) < 900, frames)[seen.order]
    return seen, Relaxed(T, np.zeros(1400 * frames, dtype=np.int64)), post


def test_a_round_post_that_turns_with_its_arm_is_at_rest():
    frames, model, post = post_and_arm(0.3)
    found = part_at_rest(frames, 0, model)
    assert found.n_parts == 2
    np.testing.assert_array_equal(found.T[:, 1], np.tile(np.eye(4), (4, 1, 1)))
    at_rest = found.labels == 1
    assert at_rest[post].mean() > 0.65  # all but what is near the arm
    assert at_rest[~post].mean() < 0.15


def test_where_a_part_is_at_rest_there_is_nothing_to_find():
    frames, model, _ = post_and_arm(0.0)
    assert part_at_rest(frames, 0, model) is model
