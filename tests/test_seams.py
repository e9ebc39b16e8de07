"""Seams: a link that lost its round housing to the part that turns in it gets it back, up to its face."""

import numpy as np

from rearticulate.geometry.kinematics import forward_kinematics
from rearticulate.geometry.se3 import transform
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.seams import cut_seams
from rearticulate.observe.frames import make_frames

PARENT = np.array([-1, 0, 1])
AXES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def twists(origin):
    """A hip that turns about x and an arm that turns about y, both through the origin (3,)."""
    return np.concatenate([AXES, np.cross(origin, AXES)], axis=1)


def hip_and_arm(rng):
    """A plate, a round housing about the y axis that ends in a face at y = 3, and an arm beyond it; labels."""
    plate = np.column_stack([rng.uniform(-5, 5, (400, 2)), np.full(400, -3.0)])
    angle, r = rng.uniform(0, 2 * np.pi, 220), 2.0
    wall = np.column_stack([r * np.cos(angle), rng.uniform(0, 3, 220), r * np.sin(angle)])[:150]
    disc = np.column_stack([np.cos(angle), np.full(220, 3.0), np.sin(angle)])[150:]
    disc[:, [0, 2]] *= r * np.sqrt(rng.uniform(0, 1, (70, 1)))
    box = rng.uniform([-2, 3.3, -1.5], [9, 6, 1.5], (400, 3))
    side = rng.integers(0, 3, 400)
    box[side == 0, 1] = 6.0
    box[side == 1, 2], box[side == 2, 2] = 1.5, -1.5
    return np.concatenate([plate, wall, disc, box]), np.repeat([0, 1, 2], [400, 220, 400])


def test_an_empty_link_takes_its_round_housing_back():
    rng, F = np.random.default_rng(3), 8
    q = np.zeros((F, 3))
    q[1:, 1], q[1:, 2] = rng.uniform(-0.4, 0.4, F - 1), rng.uniform(-0.9, 0.9, F - 1)
    T = forward_kinematics(PARENT, twists(np.zeros(3)), q)
    clouds, true = [], []
    for f in range(F):
        points, labels = hip_and_arm(rng)
        clouds.append(transform(T[f, labels], points))
        true.append(labels)
    frames = make_frames(clouds)
    true = np.concatenate(true)[frames.order]
    # the root stands still, so its pose stays the identity under the change of origin and unit
    tree = Articulated(PARENT, twists(-frames.centre / frames.unit), np.ones(3, bool), q, np.tile(np.eye(4), (F, 1, 1)))
    lost = np.where(true == 1, 2, true)
    labels = cut_seams(frames, tree, lost, only_empty=True)
    claimed = true[labels == 1]
    assert len(claimed) > 50 * F  # what lies near the plate; the labeller goes on from there
    assert np.mean(claimed == 1) > 0.98
    assert np.mean(labels[true == 2] == 2) > 0.98
    np.testing.assert_array_equal(labels[true == 0], 0)
