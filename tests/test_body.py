"""One rigid body in all frames: partners by brute force, equations by finite differences, motions recovered."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from rearticulate.geometry.cells import sort_into_cells
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.observe.body import (
    DENIED,
    HERE,
    POINT_SHARE,
    POINT_WEIGHT,
    REACH,
    WITHIN,
    Body,
    doubt,
    growth,
    make_body,
    misfits,
    own_misfits,
    pair_equations,
    partners,
    register,
    shares,
)
from rearticulate.observe.frames import Frames, make_frames
from rearticulate.parts.bodies import bodies_equations

NOISE = 0.1


def block(frames: int = 4, points: int = 900, seed: int = 0) -> tuple[Frames, np.ndarray]:
    """A block that moves freely, and its poses (F, 4, 4), canonical frame 0."""
    rng = np.random.default_rng(seed)
    size = np.array([1.0, 0.6, 0.4])
    twist = np.concatenate([rng.normal(0, 0.3, (frames, 3)), rng.normal(0, 0.5, (frames, 3))], axis=1)
    twist[0] = 0.0
    T, clouds = exp_se3(twist), []
    for f in range(frames):
        x = rng.uniform(-0.5, 0.5, (points, 3))
        face = rng.choice(3, points, p=np.array([0.24, 0.4, 0.6]) / 1.24)
        x[np.arange(points), face] = 0.5 * rng.choice([-1, 1], points)
        clouds.append(transform(T[f], x * size))
    made = make_frames(clouds)
    T[:, :3, 3] = (T[:, :3, 3] + np.einsum("fij,j->fi", T[:, :3, :3], made.centre) - made.centre) / made.unit
    return made, T @ inverse(T[0])


@pytest.fixture(scope="module")
def seen() -> tuple[Frames, Body]:
    frames, T = block()
    return frames, make_body(frames, np.arange(len(frames.points)), T)


@pytest.mark.parametrize("reach", [0.5, 2.0, 30.0])
def test_what_is_near_lies_in_the_cells_around(reach: float) -> None:
    rng = np.random.default_rng(0)
    points, places = rng.uniform(-9, 9, (400, 3)), rng.uniform(-12, 12, (60, 3))
    cells = sort_into_cells(points, reach)
    for place, near in zip(places, KDTree(points).query_ball_point(places, reach), strict=True):
        home = ((place - cells.low) // cells.size).astype(int)
        found: set[int] = set()
        for offset in np.ndindex(3, 3, 3):
            at = home + np.array(offset) - 1
            if (at >= 0).all() and (at < cells.shape).all():
                k = (at[0] * cells.shape[1] + at[1]) * cells.shape[2] + at[2]
                found |= set(cells.order[cells.start[k] : cells.start[k + 1]].tolist())
        assert set(near) <= found
    assert sorted(cells.order.tolist()) == list(range(400))


def test_partners_are_those_of_brute_force(seen: tuple[Frames, Body]) -> None:
    _, body = seen
    misfit, partner = partners(body.z[:200], body.frame[:200], body, NOISE)
    for i in range(200):
        for g in range(4):
            if body.frame[i] == g:
                assert partner[i, g] == HERE and misfit[i, g] == 0
                continue
            rows = np.flatnonzero(body.frame == g)
            gap = body.z[i] - body.z[rows]
            square = (gap**2).sum(axis=1)
            close = np.flatnonzero(square < REACH**2)
            across = np.einsum("ni,ni->n", gap[close], body.normals[rows[close]]) ** 2
            cost = across / NOISE**2 + WITHIN * (square[close] - across)
            assert misfit[i, g] == pytest.approx(min(cost.min(initial=np.inf), DENIED))
            assert partner[i, g] == (rows[close[cost.argmin()]] if len(cost) else -1)


def test_the_true_motion_explains_best_and_strangers_are_denied(seen: tuple[Frames, Body]) -> None:
    frames, body = seen
    right = own_misfits(body, NOISE).mean()
    for axis in range(6):
        shift = np.tile(np.eye(4), (4, 1, 1))
        shift[2] = exp_se3(np.eye(6)[axis] * (0.05 if axis < 3 else 0.5))
        assert own_misfits(body.moved(body.T @ shift), NOISE).mean() > 1.1 * right
    assert np.all(misfits(body.z + 50.0, body.frame, body, NOISE) == DENIED)
    assert np.array_equal(body.carry(frames, body.rows)[0], body.z)


def test_equations_are_the_gradient_and_half_the_hessian(seen: tuple[Frames, Body]) -> None:
    _, body = seen
    sigma, f = 0.5, 2
    H, g = pair_equations(body, sigma)
    partner = partners(body.z, body.frame, body, max(0.2, sigma / 3))[1]
    i, k = np.nonzero(partner >= 0)
    j = partner[i, k]
    n, count = body.normals[j], (partner != HERE).sum(axis=1)[i]
    gap = body.z[i] - body.z[j]
    robust = np.einsum("ni,ni->n", gap, n) ** 2 + POINT_SHARE * (gap**2).sum(axis=1)
    w = 0.5 * geman_mcclure(robust, sigma) / count

    def cost(twist: np.ndarray, here: bool) -> float:
        """Of the pairs of frame f as the asked (or as the partners), that side moved by a twist."""
        side = body.frame[i if here else j] == f
        moved = transform(exp_se3(twist), body.z[(i if here else j)[side]])
        d = moved - body.z[(j if here else i)[side]]
        return float((w[side] * (np.einsum("ni,ni->n", d, n[side]) ** 2 + POINT_WEIGHT * (d**2).sum(axis=1))).sum())

    step = 1e-5
    for a in range(6):
        e = step * np.eye(6)[a]
        both = sum(cost(e, here) - cost(-e, here) for here in (True, False)) / (2 * step)
        assert g[f, a] == pytest.approx(both / 2, rel=1e-4, abs=1e-4)
    assert np.allclose(H, np.swapaxes(H, 1, 2)) and np.linalg.eigvalsh(H[f]).min() > 0


def test_twists_of_poses_are_those_of_points_the_other_way(seen: tuple[Frames, Body]) -> None:
    """The same change of the cost, whether the points move at canonical or the pose moves in the world."""
    _, body = seen
    H, g = pair_equations(body, 0.5)
    H_pose, g_pose = bodies_equations((body,), 0.5)
    rng = np.random.default_rng(0)
    for f in range(4):
        eta = 1e-3 * rng.normal(size=6)
        moved = exp_se3(eta) @ body.T[f]  # carries points to canonical by the inverse
        xi_matrix = inverse(moved) @ body.T[f]
        x = rng.normal(size=(5, 3))
        xi = np.linalg.lstsq(
            np.concatenate([np.concatenate([-_cross(p), np.eye(3)], axis=1) for p in x]),
            (transform(xi_matrix, x) - x).ravel(),
            rcond=None,
        )[0]
        assert g_pose[f, 0] @ eta == pytest.approx(g[f] @ xi, rel=0.02, abs=1e-6)
        assert eta @ H_pose[f, 0] @ eta == pytest.approx(xi @ H[f] @ xi, rel=0.02)


def _cross(p: np.ndarray) -> np.ndarray:
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])


@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_disturbed_motion_is_found_again(count: int) -> None:
    frames, T = block(count, seed=count)
    rng = np.random.default_rng(1)
    rows = np.arange(len(frames.points))
    noise = exp_se3(np.concatenate([rng.normal(0, 0.01, (count, 3)), rng.normal(0, 0.4, (count, 3))], axis=1))
    noise[0] = np.eye(4)
    found = register(frames, 0, make_body(frames, rows, T @ noise), (1.0, 0.5, 0.3))
    x = frames.points[frames.rows(0)]
    error = np.linalg.norm(transform(found.T[:, None], x) - transform(T[:, None], x), axis=-1)
    assert error.mean() < 0.1 and np.allclose(found.T[0], np.eye(4), atol=1e-9)


def test_an_empty_body_and_one_of_a_single_frame_are_no_error() -> None:
    frames, T = block()
    empty = make_body(frames, np.zeros(0, dtype=int), T)
    assert own_misfits(empty, NOISE).shape == (0,) and not pair_equations(empty, 0.5)[0].any()
    alone = make_body(frames, np.arange(50), T)
    assert np.all(own_misfits(alone, NOISE) == DENIED)


def test_another_draw_of_the_points_changes_the_misfit_within_its_doubt_and_a_wrong_motion_beyond_it() -> None:
    def drawn(seed: int, off: float = 0.0) -> np.ndarray:
        frames, T = block(seed=seed)
        T[2, 0, 3] += off
        return shares(frames, make_body(frames, np.arange(len(frames.points)), T))

    first = drawn(0)
    for seed in range(1, 7):
        same, wrong = growth(first, drawn(seed)), growth(first, drawn(seed, 0.2))
        assert abs(same.sum()) < 2 * doubt(same)  # as points share partners
        assert wrong.sum() > 2 * doubt(wrong)
