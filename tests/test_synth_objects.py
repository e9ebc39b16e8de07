"""Recordings of analytic objects: every ground-truth number is checked against the surfaces or the formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from rearticulate.geometry.se3 import exp_se3, inverse, log_se3, transform
from rearticulate.records import Array
from rearticulate.synth import surfaces
from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder, record
from rearticulate.synth.objects import OBJECTS, arm, cabinet, hinge, random_tree, rigid, spinning_rod
from rearticulate.synth.trajectories import root_walk, sweep
from rearticulate.synth.visibility import visible_points


def distance_to_surface(points: Array, triangles: Array) -> Array:
    """(N,) distance of points (N, 3) to the nearest of triangles (T, 3, 3)."""
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False)
    return trimesh.proximity.closest_point(mesh, points)[1]


@pytest.mark.parametrize("name", OBJECTS)
def test_points_lie_on_their_own_parts_surface(name):
    thing = OBJECTS[name]()
    sequence, truth = record(thing, frames=3, points=120, moving_root=True, seed=1)
    T_world_part = thing.forward(truth.joint_state, truth.poses[:, 0])  # the root stands at the identity in frame 0
    for f in range(3):
        for p in range(thing.n_parts):
            rest = transform(inverse(T_world_part[f, p]), sequence.points[f][truth.labels[f] == p])
            assert len(rest) > 0
            assert distance_to_surface(rest, thing.surfaces[p]).max() < 1e-9


@pytest.mark.parametrize("name", OBJECTS)
def test_true_joints_explain_the_true_poses(name):
    thing = OBJECTS[name]()
    _, truth = record(thing, frames=5, points=64, moving_root=True, seed=2)
    for j in range(1, thing.n_parts):
        relative = inverse(truth.poses[:, truth.parent[j]]) @ truth.poses[:, j]
        axis, point = truth.joint_axis[j], truth.joint_point[j]
        turning = truth.joint_type[j] == "revolute"
        twist = np.r_[axis, np.cross(point, axis)] if turning else np.r_[0, 0, 0, axis]
        q = truth.joint_state[:, j] - truth.joint_state[0, j]
        np.testing.assert_allclose(relative, exp_se3(q[:, None] * twist), atol=1e-12)


@pytest.mark.parametrize("name", OBJECTS)
def test_steps_and_limits_are_kept(name):
    thing = OBJECTS[name]()
    _, truth = record(thing, frames=40, points=8, step_deg=10, step_m=0.02, novel=50, seed=3)
    q = truth.joint_state[:, 1:]
    largest = np.where(thing.revolute[1:], np.deg2rad(12), 0.024)
    assert (np.abs(np.diff(q, axis=0)) <= largest + 1e-12).all()
    assert (q >= thing.limits[1:, 0]).all() and (q <= thing.limits[1:, 1]).all()
    assert (np.ptp(q, axis=0) > 2 * largest).all()
    assert np.allclose(truth.joint_state[:, 0], 0)
    assert truth.novel.shape == (50, thing.n_parts, 4, 4)


def test_points_are_spread_evenly_over_the_area():
    thing = cabinet()
    _, truth = record(thing, frames=1, points=40_000, seed=4)
    area = np.array([surfaces.areas(s).sum() for s in thing.surfaces])
    share = np.bincount(truth.labels[0]) / 40_000
    np.testing.assert_allclose(share, area / area.sum(), atol=0.01)


def test_a_triangle_is_sampled_uniformly():
    triangle = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 1, 0]]])
    points, _ = surfaces.sample(triangle, 20_000, np.random.default_rng(0))
    np.testing.assert_allclose(points.mean(axis=0), triangle[0].mean(axis=0), atol=0.01)
    assert ((points[:, 0] / 2 + points[:, 1]) <= 1 + 1e-12).all() and (points[:, :2] >= 0).all()


def test_areas_of_primitives():
    assert surfaces.areas(surfaces.box((1, 2, 3))).sum() == pytest.approx(22)
    polygon = 64 * np.sin(np.pi / 64)  # half the circumference of the inscribed polygon
    cap = 32 * np.sin(2 * np.pi / 64)
    lateral_and_caps = 2 * polygon * 0.1 * 2 + 2 * cap * 0.01
    assert surfaces.areas(surfaces.cylinder(0.1, (0, 0, 0), (0, 2, 0))).sum() == pytest.approx(lateral_and_caps)
    tray = surfaces.open_box((1, 1, 1), 0.1)
    assert tray.reshape(-1, 3).min(axis=0) == pytest.approx([-0.5, -0.5, -0.5])
    assert len(tray) == 5 * 12


def test_seeds_reproduce_bit_for_bit_and_differ():
    options = {"frames": 3, "points": 100, "noise": 0.001, "moving_root": True, "one_sided": True}
    first, again, other = (record(arm(), seed=seed, **options) for seed in (7, 7, 8))
    assert all(np.array_equal(a, b) for a, b in zip(first[0].points, again[0].points, strict=True))
    assert np.array_equal(first[1].poses, again[1].poses) and np.array_equal(first[1].novel, again[1].novel)
    assert not np.array_equal(first[0].points[0], other[0].points[0])


def test_noise_has_the_asked_size():
    clean, noisy = (record(hinge(), frames=2, points=5000, noise=sigma, seed=5)[0] for sigma in (0.0, 0.003))
    assert np.std(noisy.points[0] - clean.points[0]) == pytest.approx(0.003, rel=0.05)


def test_given_joint_values_are_used():
    q = np.array([[0.0, 0.1], [0.0, 0.6]])
    _, truth = record(hinge(), q=q, points=10)
    assert np.array_equal(truth.joint_state, q)
    assert log_se3(truth.poses[1, 1])[1] == pytest.approx(0.5)


def test_moving_root_moves_a_rigid_body_by_the_stated_amount():
    sequence, truth = record(rigid(), frames=6, points=200, moving_root=True)
    steps = truth.poses[1:, 0] @ inverse(truth.poses[:-1, 0])
    np.testing.assert_allclose(np.linalg.norm(log_se3(steps)[:, :3], axis=1), np.deg2rad(5), atol=1e-12)
    assert len(sequence) == 6 and truth.parent.tolist() == [-1]


def test_walk_keeps_the_centre_near():
    centre = np.array([3.0, -2.0, 1.0])
    moved = transform(root_walk(20, centre, np.random.default_rng(0), step=0.01), np.tile(centre, (20, 1)))
    np.testing.assert_allclose(np.linalg.norm(np.diff(moved, axis=0), axis=1), 0.01, atol=1e-12)


def test_a_sweep_turns_round_at_its_limits():
    limits = np.array([[0.0, 0.25], [0.4, 0.4], [-np.inf, np.inf]])
    q = sweep(np.array([0.1, 0.4, 0.0]), limits, np.full(3, 0.1), 50, np.random.default_rng(0))
    assert q[:, 0].min() >= 0 and q[:, 0].max() <= 0.25 and np.ptp(q[:, 0]) > 0.2
    assert (q[:, 1] == 0.4).all()
    assert np.all(np.abs(np.diff(q[:, 2])) >= 0.08) and abs(q[-1, 2]) > 4


def test_turning_a_round_rod_changes_nothing_that_can_be_seen():
    thing = spinning_rod()
    turned = surfaces.moved(exp_se3(0.7 * thing.twists[1]), thing.surfaces[1]).reshape(-1, 3)
    assert distance_to_surface(turned, thing.surfaces[1]).max() < 1e-4


def test_a_mimicking_joint_follows_its_leader():
    build = ObjectBuilder("base", surfaces.box((1, 1, 1)))
    finger = surfaces.box((0.1, 0.1, 0.5))
    lead = build.add("left", finger, 0, "prismatic", axis=(1, 0, 0), limits=(0, 0.3))
    build.add("right", finger, 0, "prismatic", axis=(-1, 0, 0), limits=(0, 0.6), mimic=(lead, 2.0, 0.01))
    _, truth = record(build.build(), frames=8, points=16)
    np.testing.assert_allclose(truth.joint_state[:, 2], 2 * truth.joint_state[:, 1] + 0.01)
    assert np.ptp(truth.joint_state[:, 1]) > 0


@pytest.mark.parametrize("seed", range(5))
def test_random_trees_are_trees_with_parents_first(seed):
    thing = random_tree(8, seed=seed)
    assert thing.n_parts == 8 and thing.parent[0] == -1
    assert (thing.parent[1:] < np.arange(1, 8)).all() and (thing.parent[1:] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(thing.axis[1:], axis=1), 1)


def test_successive_joints_of_an_arm_are_not_parallel():
    thing = arm(6)
    assert (np.abs((thing.axis[1:-1] * thing.axis[2:]).sum(axis=1)) < 1e-9).all()


def ball() -> ArticulatedObject:
    sphere = np.asarray(trimesh.creation.icosphere(subdivisions=4, radius=0.5).triangles)
    return ObjectBuilder("ball", sphere).build()


def test_a_camera_sees_the_near_side_of_a_ball():
    points, _ = surfaces.sample(ball().surfaces[0], 8000, np.random.default_rng(0))
    seen = visible_points(points, np.array([0.0, 0, 2.0]))
    height = points[seen, 2]  # from 3 radii away the horizon lies at a third of the radius
    assert height.min() > 0.1
    assert np.isin(np.flatnonzero(points[:, 2] > 0.25), seen).mean() > 0.99
    assert (np.diff(seen) > 0).all()


def test_one_sided_frames_are_full_and_hide_the_back():
    sequence, truth = record(ball(), frames=2, points=500, one_sided=True, seed=6)
    assert [len(p) for p in sequence.points] == [500, 500] and len(truth.labels[0]) == 500
    assert np.linalg.norm(sequence.points[0].mean(axis=0)) > 0.2  # of a whole ball it would be near 0


def test_an_object_needs_no_motion():
    still = replace(hinge(), limits=np.zeros((2, 2)))
    _, truth = record(still, frames=3, points=10)
    assert np.array_equal(truth.poses, np.broadcast_to(np.eye(4), truth.poses.shape))
