"""Bodies from points: shapes with known volumes, sheets, and points that span nothing."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rearticulate.posing.fuse import fuse, without_strays
from rearticulate.shape.body import FLAT, ShapeConfig, beyond, grown, hull_of, make_body, sound
from rearticulate.shape.surface import Grid, ball_radius, closing, handles, surface, unpierced
from toy_result import toy

CONFIG = ShapeConfig(density=1000.0)


def sampled(mesh: trimesh.Trimesh, n: int, seed: int = 0) -> np.ndarray:
    return trimesh.sample.sample_surface(mesh, n, seed=seed)[0]


def body_of(points: np.ndarray, config: ShapeConfig = CONFIG):
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    size = size or 1.0
    return make_body(points, np.zeros(3), size, config), size


@pytest.mark.parametrize(
    "mesh",
    [trimesh.creation.icosphere(subdivisions=4), trimesh.creation.box((1, 2, 0.5)), trimesh.creation.torus(1.0, 0.3)],
    ids=["sphere", "box", "torus"],
)
def test_a_sampled_surface_comes_back_closed_and_of_the_right_size(mesh: trimesh.Trimesh) -> None:
    points = sampled(mesh, 6000)
    found = surface(points, 4000)
    assert found is not None and found.is_watertight and len(found.faces) <= 4000
    assert found.volume == pytest.approx(mesh.volume, rel=0.06)
    assert found.euler_number == mesh.euler_number
    gap = np.abs(trimesh.proximity.closest_point(mesh, found.vertices)[1])
    assert gap.max() < 0.02 * mesh.scale


def test_mass_and_inertia_are_those_of_the_solid() -> None:
    box = trimesh.creation.box((0.3, 0.2, 0.1), transform=trimesh.transformations.translation_matrix([1, 2, 3]))
    body, _ = body_of(sampled(box, 8000))
    assert body.mass == pytest.approx(6.0, rel=0.06)
    np.testing.assert_allclose(body.centre, [1, 2, 3], atol=2e-3)
    np.testing.assert_allclose(np.diag(body.inertia), 0.5 * np.array([0.05, 0.1, 0.13]), rtol=0.1)
    assert (np.linalg.eigvalsh(body.inertia) > 0).all() and body.note == ""


def test_a_cup_stays_hollow_and_its_pieces_leave_the_hollow_free() -> None:
    cup = trimesh.creation.annulus(0.8, 1.0, 1.0)
    cup = cup.union(
        trimesh.creation.cylinder(1.0, 0.2, transform=trimesh.transformations.translation_matrix([0, 0, -0.5]))
    )
    body, _ = body_of(sampled(cup, 12_000))
    assert not body.surface.contains([[0, 0, 0.3]]).any()
    assert len(body.pieces) > 1
    assert not any(piece.contains([[0, 0, 0.3]])[0] for piece in body.pieces)
    assert body.surface.volume == pytest.approx(cup.volume, rel=0.15)


def test_a_thin_tube_is_not_pierced() -> None:
    rng = np.random.default_rng(0)
    angle, z = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(-2, 2, 3000)
    points = np.stack([np.cos(angle), np.sin(angle), z], axis=1)
    radius = ball_radius(points)
    pierced = closing(points, Grid.around(points, radius))
    assert pierced is not None and handles(pierced) > 5
    mesh = unpierced(points, radius)[1]
    assert mesh is not None and handles(mesh) <= 1 and mesh.is_watertight


def test_a_grating_keeps_its_openings() -> None:
    rng = np.random.default_rng(0)
    bars = [(np.array([1.0, 0.04, 0.04]), np.array([0, y, 0])) for y in np.linspace(-0.5, 0.5, 5)]
    bars += [(np.array([0.04, 1.0, 0.04]), np.array([x, 0, 0])) for x in np.linspace(-0.5, 0.5, 5)]
    points = np.concatenate([rng.uniform(-0.5, 0.5, (2500, 3)) * size + place for size, place in bars])
    found = surface(points, 4000)
    assert found is not None and handles(found) == 16


def test_pieces_hold_the_whole_surface() -> None:
    rng = np.random.default_rng(0)
    halves = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1))]
    halves[1].apply_translation([1.5, 0, 0])
    points = rng.uniform([-0.6, -0.6, -0.6], [2.1, 0.6, 0.6], (500, 3))
    pieces = grown(halves, points)
    assert len(pieces) == 2 and all(piece.is_convex for piece in pieces)
    outside = np.min([beyond(piece, points) for piece in pieces], axis=0)
    assert outside.max() < 1e-9
    assert pieces[0].bounds[1, 0] < 1.0 < pieces[1].bounds[0, 0] + 0.5


def test_slivers_have_no_hull() -> None:
    corners = np.eye(3)
    assert hull_of(corners) is None
    assert hull_of(np.concatenate([corners, corners + np.array([1, -1, 0])])) is None
    tetrahedron = hull_of(np.concatenate([corners, np.zeros((1, 3))]))
    assert tetrahedron is not None and tetrahedron.volume == pytest.approx(1 / 6)


def test_one_hull_when_asked() -> None:
    ring = trimesh.creation.annulus(0.8, 1.0, 0.4)
    assert len(body_of(sampled(ring, 4000), ShapeConfig(collision="hull"))[0].pieces) == 1


def test_a_door_scanned_from_both_sides_keeps_its_thickness() -> None:
    door = trimesh.creation.box((1.0, 0.04, 2.0))
    found = surface(sampled(door, 20_000), 4000)
    assert found is not None and found.is_watertight
    assert np.ptp(found.vertices[:, 1]) == pytest.approx(0.04, rel=0.3)


def test_a_sheet_without_thickness_becomes_a_thin_closed_body() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (4000, 3)) * [1, 0, 1]
    body, size = body_of(points)
    assert sound(body.surface, size)
    assert np.ptp(body.surface.vertices[:, 1]) < 0.05
    assert np.ptp(body.surface.vertices[:, 0]) > 1.95


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((1, 3)),
        np.array([[0, 0, 0], [1.0, 0, 0]]),
        np.linspace(0, 1, 20)[:, None] * np.ones(3),
        np.random.default_rng(1).uniform(size=(5, 3)) * [1, 1, 0],
        np.zeros((50, 3)),
    ],
    ids=["none", "one", "two", "line", "triangle", "one place"],
)
def test_points_that_span_nothing_become_a_body_that_simulators_take(points: np.ndarray) -> None:
    body, size = body_of(points)
    assert body.surface.is_watertight and body.mass > 0
    assert (np.linalg.eigvalsh(body.inertia) > 0).all()
    assert min(np.ptp(piece.vertices, axis=0).min() for piece in body.pieces) > 0.2 * FLAT * size
    assert body.note or sound(body.surface, size)


def test_points_of_all_frames_meet_in_the_canonical_pose() -> None:
    result, sequence = toy(points=80)
    clouds = fuse(result, sequence)
    for p, cloud in enumerate(clouds):
        own = result.model.points[result.model.labels == p]
        distance = np.linalg.norm(cloud[:, None] - own, axis=-1).min(axis=1)
        assert distance.max() < 1e-12
    assert sum(map(len, clouds)) > 0.95 * sum(len(points) for points in sequence.points)


def test_strays_are_left_out() -> None:
    points = sampled(trimesh.creation.icosphere(subdivisions=3), 1000)
    kept = without_strays(np.concatenate([points, [[3.0, 0, 0], [0, 0, 5.0]]]))
    np.testing.assert_array_equal(kept, points)
