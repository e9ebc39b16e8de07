"""What sensors see, against rays cast at a ball before a wall."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from rearticulate.config import FitConfig
from rearticulate.geometry.se3 import exp_se3, inverse, to_unit, transform
from rearticulate.joints.project import UNSEEN, open_share
from rearticulate.observe.body import DENIED, Body, growth, make_body, own_misfits, shares
from rearticulate.observe.frames import Frames, make_frames
from rearticulate.observe.views import EMPTY, HIDDEN, NEAR, UNKNOWN, Views
from rearticulate.parts.patches import track_patches

BALL, RADIUS, WALL, HALF = np.array([0.3, 0.0, 1.0]), 0.4, 0.0, 1.5  # a ball above a square wall in z = 0, metres
ORIGINS = np.array([[0.0, 0.0, 4.0], [2.5, 1.0, 3.5]])
EYE = np.array([0.0, 0.0, 4.0])


def ranges(origin: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n,) range at which the ray from an origin towards places y (n, 3) hits, inf where it does not."""
    ray = (y - origin) / np.linalg.norm(y - origin, axis=1, keepdims=True)
    b, c = ray @ (origin - BALL), (origin - BALL) @ (origin - BALL) - RADIUS**2
    with np.errstate(invalid="ignore", divide="ignore"):
        ball = np.where(b * b > c, -b - np.sqrt(b * b - c), np.inf)
        wall = np.where(ray[:, 2] < 0, (WALL - origin[2]) / ray[:, 2], np.inf)
    met = np.where(np.isfinite(wall)[:, None], origin + np.nan_to_num(wall, posinf=0)[:, None] * ray, np.inf)
    wall = np.where(np.abs(met[:, :2]).max(axis=1) < HALF, wall, np.inf)
    return np.fmin(ball, wall)


def taken(origin: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points of the surface where a sensor's rays hit."""
    target = np.concatenate([rng.uniform([-HALF, -HALF, 0], [HALF, HALF, 0], (count, 3)),
                             BALL + RADIUS * rng.uniform(-1, 1, (count // 4, 3))])  # fmt: skip
    r = ranges(origin, target)
    ray = (target - origin) / np.linalg.norm(target - origin, axis=1, keepdims=True)
    return (origin + r[:, None] * ray)[np.isfinite(r)]


def scene(sensors: tuple[int, ...], tell: bool = True) -> Frames:
    """Two frames of it, each from these sensors; tell: which of them took each point."""
    rng = np.random.default_rng(0)
    clouds, sensor = [], []
    for _ in range(2):
        parts = [taken(ORIGINS[s], 5000, rng) for s in sensors]
        clouds.append(np.concatenate(parts))
        sensor.append(np.repeat(np.arange(len(parts)), [len(p) for p in parts]))
    return make_frames(clouds, origins=[ORIGINS[list(sensors)]] * 2, sensor=sensor if tell else ())


def seen(frames: Frames) -> Views:
    assert frames.views is not None
    return frames.views


def test_a_gap_that_cannot_be_seen_hardly_counts() -> None:
    """Behind the ball, before the wall, and half behind the wall."""
    frames, up = scene((0,)), np.array([0, 0, 1.0])
    left, behind = np.array([-0.8, 0, 0]), np.array([0.35, 0, 0.2])
    ends = np.array(
        [[behind, behind + 0.1 * up], [left + 0.6 * up, left + 0.8 * up], [left - 0.5 * up, left + 0.5 * up]]
    )
    two_frames = np.stack([(ends - frames.centre) / frames.unit] * 2, axis=1)
    shares = np.array([open_share(seen(frames), each) for each in two_frames])
    np.testing.assert_allclose(shares[:2], [[UNSEEN] * 2, [1] * 2])
    np.testing.assert_allclose(shares[2], (1 + UNSEEN) / 2, atol=0.13)


@pytest.mark.parametrize(("sensors", "tell"), [((0,), True), ((1,), False), ((0, 1), True), ((0, 1), False)])
def test_hidden_and_empty_are_what_rays_say(sensors: tuple[int, ...], tell: bool) -> None:
    frames = scene(sensors, tell)
    rng = np.random.default_rng(1)
    places = rng.uniform([-1.2, -1.2, -0.8], [1.2, 1.2, 1.8], (4000, 3))
    found = seen(frames).classes((places - frames.centre) / frames.unit, np.ones(4000, dtype=int))
    beyond = np.stack([np.linalg.norm(places - ORIGINS[s], axis=1) - ranges(ORIGINS[s], places) for s in sensors])
    empty, hidden = found == EMPTY, found == HIDDEN
    assert (beyond[:, empty] < 0).any(axis=0).mean() > 0.999
    assert (beyond[:, hidden] > 0).all(axis=0).mean() > (0.999 if len(sensors) == 1 else 0.98)
    clear = 3 * seen(frames).tolerance * frames.unit
    passed = (np.isfinite(beyond) & (beyond < -clear)).any(axis=0)
    assert empty[passed].mean() > 0.95
    assert hidden[(beyond > clear).all(axis=0)].mean() > 0.93


def test_the_surface_itself_is_near_or_at_an_edge() -> None:
    frames = scene((0, 1))
    found = seen(frames).classes(frames.points, frames.frame)
    assert (found == HIDDEN).mean() < 0.02 and (found == EMPTY).mean() < 0.01 and (found == NEAR).mean() > 0.9


def test_where_no_sensor_looks_nothing_is_known() -> None:
    frames = scene((0,))
    aside = seen(frames).classes(frames.points + 1e4 * np.eye(3)[1], frames.frame)
    behind = seen(frames).classes(frames.points + 1e4 * np.eye(3)[2], frames.frame)
    assert (aside == UNKNOWN).all() and (behind == UNKNOWN).all()


def test_another_world_says_the_same() -> None:
    frames, T = scene((1,)), exp_se3(np.array([0.3, -1.2, 0.5, 3.0, 1.0, -2.0]))
    metres = np.split(frames.points * frames.unit + frames.centre, frames.start[1:-1])
    moved = make_frames([transform(T, p) for p in metres], origins=[transform(T, ORIGINS[1:])] * 2)
    still = make_frames(metres, origins=[ORIGINS[1:]] * 2)
    y = np.random.default_rng(2).uniform(-40, 40, (3000, 3))
    turned = (transform(T, y * still.unit + still.centre) - moved.centre) / moved.unit
    frame = np.zeros(3000, dtype=int)
    a, b = seen(still).classes(y, frame), seen(moved).classes(turned, frame)
    assert (a == b).mean() > 0.9 and not ((a == HIDDEN) & (b == EMPTY)).any()


def test_frames_that_are_taken_keep_their_views() -> None:
    frames = scene((0, 1))
    taken, y = frames.take(np.array([1])), np.random.default_rng(3).uniform(-30, 30, (2000, 3))
    ones = np.ones(2000, dtype=int)
    np.testing.assert_array_equal(seen(taken).classes(y, 0 * ones), seen(frames).classes(y, ones))
    both = seen(frames.take(np.array([0, 1])))
    for each in fields(Views):
        np.testing.assert_array_equal(getattr(both, each.name), getattr(seen(frames), each.name))
    assert make_frames([frames.points]).views is None


def behind_a_screen() -> tuple[Frames, np.ndarray]:
    """A wavy board slides sideways until half of it is behind a screen; and its motion (3,), spacings."""
    rng, clouds, step = np.random.default_rng(0), [], np.array([-0.05, 0.0, 0.0])
    for f in range(5):
        x = rng.uniform([0.02, -0.25], [0.5, 0.25], (3000, 2))
        board = np.column_stack([x, 0.05 * np.sin(14 * x[:, 0]) * np.sin(17 * x[:, 1])]) + f * step
        screen = np.column_stack([rng.uniform([-0.6, -0.5], [0.0, 0.5], (4000, 2)), np.full(4000, 0.2)])
        at_screen = EYE + 3.8 / (EYE[2] - board[:, 2:]) * (board - EYE)
        clouds.append(np.concatenate([screen, board[at_screen[:, 0] > 0]]))
    frames = make_frames(clouds, origins=[EYE[None]] * 5)
    return frames, 4 * step / frames.unit


def test_what_goes_behind_a_screen_follows_what_is_still_seen() -> None:
    frames, moved = behind_a_screen()
    x = frames.points[frames.rows(0)]
    board = x[:, 2] < x[:, 2].mean()

    def error(frames: Frames) -> np.ndarray:
        tracks = track_patches(frames, 0, FitConfig(without=("network",)))
        y = transform(tracks.T[4][tracks.patches.owner], x)
        return np.linalg.norm(y - x - moved, axis=1)[board]

    assert np.quantile(error(frames), 0.9) < 1.5
    assert np.quantile(error(replace(frames, views=None)), 0.9) > 15


def turning_block() -> tuple[Frames, Body]:
    """A block that turns before one camera, which sees other faces of it in every frame; and it as one body."""
    rng, turns, clouds = np.random.default_rng(0), np.linspace(-1.2, 1.2, 5), []
    size, T = np.array([0.5, 0.4, 0.3]), exp_se3(np.outer(turns - turns[2], [0, 1.0, 0.2, 0, 0, 0]))
    for pose in T:
        x, face = rng.uniform(-1, 1, (6000, 3)), rng.integers(0, 3, 6000)
        side = rng.choice([-1, 1], 6000)
        x[np.arange(6000), face] = side
        normal = np.zeros((6000, 3))
        normal[np.arange(6000), face] = side
        y = transform(pose, x * size)
        clouds.append(y[np.einsum("ij,ij->i", normal @ pose[:3, :3].T, EYE - y) > 0])
    frames = make_frames(clouds, origins=[EYE[None]] * 5)
    T = to_unit(T, frames.unit, frames.centre)
    return frames, make_body(frames, np.arange(len(frames.points)), T @ inverse(T[2]))


def test_of_what_frames_can_tell_nearly_all_is_confirmed() -> None:
    frames, body = turning_block()
    found, blindly = shares(frames, body), shares(replace(frames, views=None), body)
    np.testing.assert_allclose(np.nansum(blindly, axis=1), own_misfits(body, frames.noise))
    told = np.isfinite(found)
    np.testing.assert_array_equal(found[told], blindly[told])
    denied = np.isclose(blindly, DENIED / 4)
    assert denied.mean() > 0.15 and denied[told].mean() < 0.05


def test_faces_that_were_hidden_are_no_reason_to_slide() -> None:
    """Points of the block as a body of their own that slid, in the frames that hide them, onto others of it."""
    frames, body = turning_block()
    now = shares(frames, body)
    before, after = now.copy(), now.copy()
    hidden = np.isnan(now)
    after[hidden] = 0.1
    assert np.all(growth(before, after) == 0.0) and np.all(growth(after, before) == 0.0)
    assert growth(now, np.where(hidden, np.nan, now + 0.5)).sum() == pytest.approx(0.5 * (~hidden).sum())
