"""Registration: the normal equations against finite differences, and known motions found again."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3, rotate, transform
from rearticulate.observe.register import Schedule, fit_cost, normal_equations, register_bodies


def box_cloud(size, centre, n, rng):
    """Points (n, 3) on the faces of a box, with their normals."""
    face = rng.integers(0, 6, n)
    normals = np.zeros((n, 3))
    normals[np.arange(n), face % 3] = np.where(face < 3, 1.0, -1.0)
    x = rng.uniform(-1, 1, (n, 3))
    x = np.where(normals != 0, normals, x)
    return x * np.asarray(size) / 2 + centre, normals


def two_bodies():
    """Two boxes about one spacing between points, 40 spacings apart: points, normals, body."""
    rng = np.random.default_rng(0)
    a, na = box_cloud((14, 9, 5), (0, 0, 0), 500, rng)
    b, nb = box_cloud((6, 12, 8), (40, 0, 0), 500, rng)
    return np.concatenate([a, b]), np.concatenate([na, nb]), np.repeat([0, 1], 500)


def test_the_motions_of_two_bodies_are_recovered():
    points, normals, body = two_bodies()
    true = np.stack([exp_se3(np.array([0.06, -0.05, 0.08, 0.5, -0.4, 0.3])) for _ in range(2)])
    true[1] = exp_se3(np.array([0.01, 0.02, -0.01, -0.5, 0.2, 0.6]))
    target, target_normals = transform(true[body], points), rotate(true[body], normals)
    start = np.tile(np.eye(4), (2, 1, 1))
    found = register_bodies(
        KDTree(target), target_normals, points, normals, body, start, Schedule(40, sigma=3.0, sigma_end=0.5)
    )
    assert np.abs(transform(found[body], points) - target).max() < 1e-3
    np.testing.assert_array_equal(start, np.tile(np.eye(4), (2, 1, 1)))  # the start is left alone


def test_bodies_are_independent_of_each_other():
    points, normals, body = two_bodies()
    target, target_normals = transform(exp_se3(np.array([0, 0, 0.05, 0.3, 0, 0])), points), normals
    tree, schedule, start = KDTree(target), Schedule(6, 2.0, 0.6), np.tile(np.eye(4), (2, 1, 1))
    both = register_bodies(tree, target_normals, points, normals, body, start, schedule)
    mine = body == 0
    alone = register_bodies(tree, target_normals, points[mine], normals[mine], body[mine], start[:1], schedule)
    np.testing.assert_allclose(both[0], alone[0], atol=1e-12)


def test_points_beyond_the_reach_move_nothing():
    points, normals, body = two_bodies()
    start = np.tile(np.eye(4), (2, 1, 1))
    schedule = Schedule(5, 2.0, 0.5, max_distance=3.0)
    found = register_bodies(KDTree(points + np.array([0, 0, 100.0])), normals, points, normals, body, start, schedule)
    np.testing.assert_array_equal(found, start)


def test_normal_equations_are_the_derivatives_of_the_objective():
    rng = np.random.default_rng(1)
    y, z, n = rng.normal(size=(3, 30, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    plane, point = rng.uniform(0, 2, (2, 30))
    plane[3] = point[3] = 0.0
    body = rng.integers(0, 3, 30)
    H, g = normal_equations(y, z, n, plane, point, body, 4)

    def residuals(b, twist):
        mine = body == b
        d = transform(exp_se3(twist), y[mine]) - z[mine]
        across = np.sqrt(plane[mine]) * np.einsum("ij,ij->i", n[mine], d)
        return np.concatenate([across, (np.sqrt(point[mine])[:, None] * d).ravel()])

    for b in range(3):
        steps = 1e-6 * np.eye(6)
        J = np.stack([(residuals(b, s) - residuals(b, -s)) / 2e-6 for s in steps], axis=1)
        np.testing.assert_allclose(g[b], J.T @ residuals(b, np.zeros(6)), atol=1e-7)
        np.testing.assert_allclose(H[b], J.T @ J, atol=1e-6)
    assert not H[3].any() and not g[3].any()


def test_geman_mcclure_weights():
    np.testing.assert_allclose(geman_mcclure(np.array([0.0, 4.0, 36.0]), 2.0), [1.0, 0.25, 0.01])


def test_the_weight_is_the_slope_of_the_kernel():
    squared = np.array([0.01, 0.5, 7.0])

    def kernel(x):
        return x / (1 + x / 1.5**2)

    slope = (kernel(squared + 1e-6) - kernel(squared - 1e-6)) / 2e-6
    np.testing.assert_allclose(geman_mcclure(squared, 1.5), slope, rtol=1e-6)


def test_the_scale_shrinks_geometrically_from_first_to_last():
    schedule = Schedule(5, 8.0, 0.5)
    np.testing.assert_allclose([schedule.scale(i) for i in range(5)], [8, 4, 2, 1, 0.5])
    assert Schedule(1, 8.0, 0.5).scale(0) == 8.0


def test_the_misfit_is_nothing_on_the_cloud_and_capped_far_away():
    points, normals, _ = two_bodies()
    tree = KDTree(points)
    np.testing.assert_allclose(fit_cost(tree, normals, points, -normals), 0.0, atol=1e-12)
    sideways = normals[:, [1, 2, 0]]  # at right angles to its own, for normals along the axes
    np.testing.assert_allclose(fit_cost(tree, normals, points, sideways), 0.2, atol=1e-12)
    far = points + np.array([0, 0, 1000.0])
    tops = fit_cost(tree, np.tile([0.0, 0, 1], (len(points), 1)), far, np.tile([1.0, 0, 0], (len(points), 1)))
    np.testing.assert_allclose(tops, 2.0 + 0.75 + 0.2)
