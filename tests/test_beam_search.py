"""Postures from nowhere: a scan of a tree of blocks far from its rest pose, with a link that has no points, too."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rearticulate.geometry.kinematics import depth_first, forward_kinematics
from rearticulate.geometry.nearest import search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.localization.beam_search import Target, Tree, beam_search, sampled

PARENT = np.array([-1, 0, 0, 1, 2, 3])
Z, X = [0, 0, 1.0], [1.0, 0, 0]
ORIGIN = np.array([[0, 0, 0], [20, 0, 0], [-20, 0, 0], [50, 0, 0], [-50, 0, 0], [50, 0, 0]], dtype=float)
AXIS = np.array([[0, 0, 0], Z, Z, [0, 1.0, 0], X, [0, 0, 1.0]])
CENTRE = ORIGIN + np.array([[0, 0, 0], [15, 3, 0], [-15, 0, 4], [15, 0, 0], [-15, 2, 0], [15, 0, 5]])
SLIDE = 4
LIMITS = np.array([[0, 0], [-0.3, 0.3], [-0.3, 0.3], [-0.3, 0.3], [-4.0, 4.0], [-0.3, 0.3]])
TRUE = np.array([0, 1.2, -2.0, 0.7, -9.0, -1.1])


def blocks(empty: int | None) -> tuple[Tree, np.ndarray]:
    """The tree and all its points, about 0.7 apart. empty: a link without points."""
    turning = np.arange(len(PARENT)) != SLIDE
    twists = np.zeros((len(PARENT), 6))
    twists[turning] = np.concatenate([AXIS, np.cross(ORIGIN, AXIS)], axis=1)[turning]
    twists[SLIDE, 3:] = AXIS[SLIDE]
    points, normals, link = [], [], []
    for j, centre in enumerate(CENTRE):
        if j == empty:
            continue
        mesh = trimesh.creation.box((26, 8 + j, 10))
        x, face = trimesh.sample.sample_surface(mesh, 1500, seed=j)
        points.append(x + centre)
        normals.append(mesh.face_normals[face])
        link += [j] * len(x)
    x, n, part = np.concatenate(points), np.concatenate(normals), np.array(link)
    return Tree(PARENT, twists, LIMITS, *sampled(x, n, part, len(PARENT))), np.concatenate([x, n, part[:, None]], 1)


@pytest.mark.parametrize("empty", [None, 3], ids=["all links seen", "a link without points"])
def test_a_posture_far_from_all_that_was_seen_is_found(empty: int | None) -> None:
    tree, body = blocks(empty)
    link = body[:, 6].astype(int)
    T = forward_kinematics(PARENT, tree.twists, TRUE)
    normals = np.einsum("nij,nj->ni", T[link, :3, :3], body[:, 3:6])
    q, root = beam_search(tree, Target(search_tree(transform(T[link], body[:, :3])), normals), np.eye(4)[None])
    found = forward_kinematics(PARENT, tree.twists, q[0], root[0])
    miss = np.linalg.norm(transform(found[link], body[:, :3]) - transform(T[link], body[:, :3]), axis=1)
    assert miss.max() < 0.5
    if empty is None:
        np.testing.assert_allclose(q[0], TRUE, atol=0.1)


def test_depth_first_lists_every_branch_whole() -> None:
    assert depth_first(PARENT).tolist() == [0, 1, 3, 5, 2, 4]
    assert depth_first(np.array([-1])).tolist() == [0]


def test_a_renumbered_tree_is_the_same_tree() -> None:
    tree, _ = blocks(None)
    order = depth_first(tree.parent)
    other = tree.renumbered(order)
    q = np.random.default_rng(0).normal(size=len(order))
    T = forward_kinematics(tree.parent, tree.twists, q)
    T_other = forward_kinematics(other.parent, other.twists, q[order])
    np.testing.assert_allclose(T_other[other.link], T[tree.link], atol=1e-12)
