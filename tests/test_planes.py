"""Planes and layers: exact answers for sheets that lie close to each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rearticulate.observe.planes import find_planes, keep_planes, plane_layers, plane_normals

DENSITY = 0.22  # points of a frame per squared spacing


def sheets(gap: float, noise: float, n: int = 3000, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two parallel squares of n points each, as dense as four frames, and which of the two each point is of."""
    rng = np.random.default_rng(seed)
    side = np.sqrt(n / (4 * DENSITY))
    points = np.column_stack([rng.uniform(0, side, (2 * n, 2)), np.zeros(2 * n)])
    upper = np.arange(2 * n) >= n
    points[:, 2] = gap * upper + rng.normal(0, noise, 2 * n)
    return points, upper


@pytest.mark.parametrize("gap", [0.6, 1.0, 2.0])
def test_normals_do_not_see_the_other_sheet(gap: float) -> None:
    points, _ = sheets(gap, 0.01)
    off = np.degrees(np.arccos(np.clip(np.abs(plane_normals(points)[:, 2]), 0, 1)))
    assert np.quantile(off, 0.9) < 3


@pytest.mark.parametrize("gap", [0.3, 0.5, 1.0])
def test_a_layer_is_one_sheet_and_knows_its_normal(gap: float) -> None:
    points, upper = sheets(gap, 0.02)
    layer, normals = plane_layers(points)
    inside = layer >= 0
    assert inside.mean() > 0.97
    for k in np.unique(layer[inside]):
        share = upper[layer == k].mean()
        assert min(share, 1 - share) < 0.02
    assert np.median(np.abs(normals[:, 2])) > np.cos(np.radians(0.2))


def test_layers_follow_the_world() -> None:
    points, _ = sheets(0.5, 0.02)
    turn = Rotation.from_rotvec([0.3, -0.7, 0.4]).as_matrix()
    layer, normals = plane_layers(points)
    turned, turned_normals = plane_layers(points @ turn.T + [5.0, -3.0, 2.0])
    assert np.mean(layer == turned) > 0.99
    assert np.median(np.abs(np.einsum("ni,ni->n", normals @ turn.T, turned_normals))) > 0.9999


def test_a_ball_has_the_normals_of_a_ball() -> None:
    rng = np.random.default_rng(1)
    radial = rng.normal(size=(4000, 3))
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    normals = plane_layers(12 * radial)[1]
    assert np.quantile(np.abs(np.einsum("ni,ni->n", normals, radial)), 0.05) > np.cos(np.radians(6))


@pytest.mark.parametrize("n", [0, 1, 3, 4, 9])
def test_few_points(n: int) -> None:
    layer, normals = plane_layers(np.random.default_rng(0).normal(size=(n, 3)))
    assert len(layer) == len(normals) == n
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)


def test_neighbours_that_are_kept_are_those_of_a_new_search() -> None:
    rng = np.random.default_rng(4)
    everything = rng.uniform(0, 20, (3000, 3)) * [1, 1, 0.02]
    before, after = np.arange(2500), np.sort(np.r_[np.arange(60, 2500), rng.choice(500, 80, replace=False) + 2500])
    place = np.where(after < 2500, after, -1)
    kept = keep_planes(everything[after], find_planes(everything[before]), place, again=False)
    fresh = find_planes(everything[after])
    assert np.array_equal(kept.near, fresh.near)
    assert np.mean(np.abs(np.einsum("ni,ni->n", kept.normals, fresh.normals)) > 0.95) > 0.9
    again = keep_planes(everything[after], find_planes(everything[before]), place, again=True)
    assert np.array_equal(again.normals, fresh.normals)
