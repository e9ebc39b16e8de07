"""The fitter's normalised copy of a sequence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.observe.frames import estimate_normals, make_frames, point_spacing, smallest_direction


def clouds(seed=0, sizes=(150, 120, 180)):
    rng = np.random.default_rng(seed)
    return [rng.normal(size=(n, 3)) * [0.3, 0.2, 0.1] + [5.0, -2.0, 1.0] for n in sizes]


def test_metres_and_back():
    sequence = clouds()
    frames = make_frames(sequence)
    back = np.empty_like(frames.points)
    back[frames.order] = frames.points * frames.unit + frames.centre
    np.testing.assert_allclose(back, np.concatenate(sequence), atol=1e-12)
    assert frames.n_frames == 3
    np.testing.assert_array_equal(frames.start, [0, 150, 270, 450])
    for f, tree in enumerate(frames.trees):
        np.testing.assert_array_equal(tree.data, frames.points[frames.rows(f)])
        assert (frames.frame[frames.rows(f)] == f).all()


def test_the_unit_is_the_median_spacing():
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), -1).reshape(-1, 3)
    assert point_spacing([0.02 * grid, 0.02 * grid + 3]) == pytest.approx(0.02)
    frames = make_frames(clouds())
    spacing = [tree.query(tree.data, k=2)[0][:, 1] for tree in frames.trees]
    assert np.median(np.concatenate(spacing)) == pytest.approx(1.0)


def test_every_frame_counts_alike_for_the_centre():
    near, far = clouds(sizes=(100, 400))
    np.testing.assert_allclose(make_frames([near, far]).centre, (near.mean(axis=0) + far.mean(axis=0)) / 2)


def test_points_are_sorted_by_their_distance_from_the_centroid_of_their_frame():
    frames = make_frames(clouds())
    np.testing.assert_array_equal(np.sort(frames.order), np.arange(450))
    for f in range(3):
        points = frames.points[frames.rows(f)]
        assert (np.diff(np.linalg.norm(points - points.mean(axis=0), axis=1)) > -1e-9).all()
        np.testing.assert_array_equal(np.sort(frames.order[frames.rows(f)]), np.arange(*frames.start[f : f + 2]))


def assert_same(a, b, atol=1e-9):
    np.testing.assert_allclose(a.points, b.points, atol=atol)
    np.testing.assert_array_equal(a.start, b.start)
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", a.normals, b.normals)), 1.0, atol=1e-9)


def test_the_order_of_the_input_does_not_matter():
    rng = np.random.default_rng(3)
    sequence = clouds()
    shuffled = [rng.permutation(len(p)) for p in sequence]
    a, b = make_frames(sequence), make_frames([p[s] for p, s in zip(sequence, shuffled, strict=True)])
    assert_same(a, b)
    assert b.unit == pytest.approx(a.unit, rel=1e-12)
    flat = np.concatenate([s + start for s, start in zip(shuffled, a.start[:-1], strict=True)])
    np.testing.assert_array_equal(flat[b.order], a.order)


def test_millimetres_are_as_good_as_metres():
    a, b = make_frames(clouds()), make_frames([1000 * p for p in clouds()])
    assert_same(a, b)
    assert b.unit == pytest.approx(1000 * a.unit)


def test_a_turned_world_turns_the_points_and_keeps_their_order():
    T = exp_se3(np.array([0.4, -1.0, 2.0, 10.0, 20.0, -5.0]))
    a, b = make_frames(clouds()), make_frames([transform(T, p) for p in clouds()])
    np.testing.assert_allclose(b.points, a.points @ T[:3, :3].T, atol=1e-9)
    np.testing.assert_array_equal(a.order, b.order)


def test_normals_of_a_plane():
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.uniform(0, 20, (400, 2)), np.zeros(400)])
    T = exp_se3(np.array([0.5, 0.7, -0.2, 1.0, 2.0, 3.0]))
    points = transform(T, flat)
    normals = estimate_normals(points, KDTree(points))
    np.testing.assert_allclose(np.abs(normals @ T[:3, 2]), 1.0, atol=1e-9)


def test_normals_of_a_sphere():
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(5000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normals = estimate_normals(30 * direction + 7, KDTree(30 * direction + 7))
    angle = np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", normals, direction)), 0, 1))
    assert np.median(angle) < np.deg2rad(2)
    assert angle.max() < np.deg2rad(10)


def test_the_smallest_direction_of_each_set():
    rng = np.random.default_rng(6)
    patches = rng.normal(size=(3, 50, 3)) * np.array([[[5, 3, 0.1]], [[0.1, 5, 3]], [[3, 0.1, 5]]]) + 100
    found = np.abs(smallest_direction(patches.reshape(-1, 3), np.arange(150).reshape(3, 50)))
    np.testing.assert_allclose(found, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=0.05)
