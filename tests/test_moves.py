"""Changes of the bodies: each proposes what it should on a case with a known answer, and none raises the score."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rearticulate.config import FitConfig
from rearticulate.evaluation.clustering import rand_index
from rearticulate.geometry.se3 import exp_se3, inverse, to_unit, transform
from rearticulate.observe.frames import Frames, make_frames
from rearticulate.parts.bodies import Bodies, labels_of, make_bodies, poses, score, settled, without_crumbs
from rearticulate.parts.ownership import exchange, relabel
from rearticulate.parts.relaxed import Relaxed
from rearticulate.search.explain import explain
from rearticulate.search.moves.combine import combine_bodies
from rearticulate.search.moves.merge import merge_bodies
from rearticulate.search.moves.slides import screws, slides
from rearticulate.search.moves.split import split_bodies, travel
from rearticulate.search.moves.sweep import sweep_bodies
from rearticulate.synth import objects
from rearticulate.synth.articulated import ArticulatedObject, record

Case = tuple[Frames, np.ndarray, np.ndarray]  # frames, true poses (F, P, 4, 4), true labels (M,)


def case(thing: ArticulatedObject, step: float = 15.0, points: int = 1200, seed: int = 1, canonical: int = 2) -> Case:
    sequence, truth = record(thing, frames=5, points=points, step_deg=step, seed=seed)
    made = make_frames(sequence.points)
    T = to_unit(truth.motion(canonical), made.unit, made.centre)
    return made, T, np.concatenate(truth.labels)[made.order]


@pytest.fixture(scope="module")
def hinge() -> Case:
    return case(objects.hinge())


@pytest.fixture(scope="module")
def cabinet() -> Case:
    return case(objects.cabinet(), points=2500)


def bodies_of(found: Case, labels: np.ndarray | None = None, T: np.ndarray | None = None) -> Bodies:
    frames, true_T, true_labels = found
    return make_bodies(frames, true_T if T is None else T, true_labels if labels is None else labels)


def agreement(found: Case, bodies: Bodies) -> float:
    return rand_index(found[2], labels_of(bodies, len(found[2])))


def cut_in_two(found: Case, part: int) -> Bodies:
    """A third body of half of one part."""
    frames, T, labels = found
    body = bodies_of(found)[part]
    upper = body.z[:, 0] > np.median(body.z[:, 0])
    changed = labels.copy()
    changed[body.rows[upper]] = T.shape[1]
    return make_bodies(frames, np.concatenate([T, T[:, part : part + 1]], axis=1), changed)


@pytest.mark.parametrize("part", [0, 1])
def test_halves_of_one_part_are_merged_and_parts_are_not(hinge: Case, part: int) -> None:
    frames = hinge[0]
    merged = merge_bodies(frames, 2, cut_in_two(hinge, part))
    assert len(merged) == 2 and agreement(hinge, merged) == 1
    assert len(merge_bodies(frames, 2, bodies_of(hinge))) == 2


def test_two_parts_in_one_body_are_split_and_parts_are_not(hinge: Case) -> None:
    slow = case(objects.hinge(), step=4, seed=3)
    frames, T, labels = slow
    one = settled(frames, 2, make_bodies(frames, T[:, :1], np.zeros_like(labels)), (0.5, 0.3))
    two = split_bodies(frames, 2, one)
    assert len(two) > 1 and score(frames, two) < score(frames, one)
    found = explain(frames, 2, one, FitConfig())
    lowest = score(frames, found)
    assert len(found) == 2 and agreement(slow, found) > 0.97 and lowest < 1.1 * score(frames, bodies_of(slow))
    assert len(split_bodies(hinge[0], 2, bodies_of(hinge))) == 2


def test_a_part_that_another_start_found_is_taken_over_and_a_worse_one_is_not(cabinet: Case) -> None:
    frames, T, labels = cabinet
    right = bodies_of(cabinet)
    less = make_bodies(frames, T[:, :-1], np.where(labels == T.shape[1] - 1, 0, labels))
    other = Relaxed(T @ inverse(T[4])[None], labels)  # from another canonical frame
    found = combine_bodies(frames, 2, less, [other])
    assert agreement(cabinet, found) == 1 and score(frames, found) < score(frames, less)
    np.testing.assert_allclose(poses(found)[2], np.tile(np.eye(4), (T.shape[1], 1, 1)), atol=1e-9)
    assert combine_bodies(frames, 2, right, [other]) is right
    assert len(combine_bodies(frames, 2, right, [Relaxed(T[:, :1], np.zeros_like(labels))])) == T.shape[1]


def bar(slides: np.ndarray) -> tuple[Frames, np.ndarray]:
    """A long thin bar that slides along itself, and its poses."""
    rng, clouds = np.random.default_rng(0), []
    for s in slides:
        x = np.stack([rng.uniform(-12, 12, 1500), rng.uniform(-2, 2, 1500), rng.choice([-0.7, 0.7], 1500)], axis=1)
        clouds.append(x + np.array([s, 0, 0]))
    frames = make_frames(clouds)
    T = np.tile(np.eye(4), (len(slides), 1, 1))
    T[:, 0, 3] = (slides - slides[0]) / frames.unit
    return frames, T


def test_a_sweep_finds_how_far_a_bar_slid_along_itself() -> None:
    frames, T = bar(np.array([0.0, 1.5, -1.0, 2.5]))
    still = make_bodies(frames, np.tile(np.eye(4), (4, 1, 1, 1)), np.zeros(len(frames.points), dtype=int))
    found = sweep_bodies(frames, 0, settled(frames, 0, still, (0.5,)))
    x = frames.points[frames.rows(0)]
    error = np.linalg.norm(transform(found[0].T[:, None], x) - transform(T[:, None], x), axis=-1).mean(axis=1)
    assert error.max() < 2
    right = make_bodies(frames, T[:, None], np.zeros(len(frames.points), dtype=int))
    assert score(frames, found) < score(frames, right) + 10 < score(frames, still)


def test_a_sweep_leaves_a_body_that_is_right(hinge: Case) -> None:
    before = settled(hinge[0], 2, bodies_of(hinge), (0.4, 0.3))
    after = sweep_bodies(hinge[0], 2, before)
    assert np.abs(poses(after)[..., :3, 3] - poses(before)[..., :3, 3]).max() < 0.3


def drawers(slides: tuple[np.ndarray, np.ndarray]) -> Case:
    """A plate at rest and two drawers below it, one above the other, that slide along x: two walls and a front."""
    rng, clouds, labels = np.random.default_rng(2), [], []
    for first, second in zip(*slides, strict=True):
        plate = np.column_stack([rng.uniform(-9, 9, 900), rng.uniform(-9, 9, 900), np.full(900, 4.0)])
        both = []
        for height, slide in ((0.0, first), (-4.2, second)):
            wall = np.column_stack([rng.uniform(-6, 6, 450), rng.choice([-3.0, 3.0], 450), rng.uniform(-2, 2, 450)])
            front = np.column_stack([np.full(150, 6.0), rng.uniform(-3, 3, 150), rng.uniform(-2, 2, 150)])
            both.append(np.concatenate([wall, front]) + np.array([slide, 0, height]))
        clouds.append(np.concatenate([plate, *both]))
        labels.append(np.repeat([0, 1, 2], [900, 600, 600]))
    frames = make_frames(clouds)
    T = np.tile(np.eye(4), (len(clouds), 3, 1, 1))
    T[:, 1, 0, 3], T[:, 2, 0, 3] = ((slide - slide[0]) / frames.unit for slide in slides)
    return frames, T, np.concatenate(labels)[frames.order]


def test_a_drawer_that_was_taken_for_another_is_told_by_its_front_though_its_walls_slide_in_themselves() -> None:
    found = drawers((np.array([0.0, 2.0, 1.0, 3.0]), np.array([0.0, 0.5, 3.5, 1.0])))
    frames, T, labels = found
    lump = make_bodies(frames, T[:, :2], np.minimum(labels, 1))
    apart = split_bodies(frames, 0, lump)
    assert score(frames, apart) < 0.95 * score(frames, lump)
    second = max((body for body in apart if (labels[body.rows] == 2).mean() > 0.97), key=len)
    assert len(second) > 600
    x = second.z[second.frame == 0]
    assert np.linalg.norm(transform(second.T[:, None], x) - transform(T[:, None, 2], x), axis=-1).mean() < 0.5


def spoilt(found: Case, share: float, seed: int = 0) -> np.ndarray:
    """Labels of which patches are wrong."""
    frames, T, labels = found
    rng, out = np.random.default_rng(seed), labels.copy()
    for f in range(frames.n_frames):
        points = frames.points[frames.rows(f)]
        for centre in points[rng.choice(len(points), 8)]:
            near = np.argsort(((points - centre) ** 2).sum(axis=1))[: int(share * len(points) / 8)]
            out[frames.start[f] + near] = rng.integers(0, T.shape[1])
    return out


def test_labels_come_back_under_true_motions(cabinet: Case) -> None:
    frames, T, _ = cabinet
    wrong = make_bodies(frames, T, spoilt(cabinet, 0.3))
    mended = exchange(frames, relabel(frames, wrong))
    assert agreement(cabinet, wrong) < 0.9 and agreement(cabinet, mended) > 0.97
    assert score(frames, mended) < score(frames, wrong)


def test_labels_that_are_right_stay(cabinet: Case) -> None:
    frames = cabinet[0]
    assert agreement(cabinet, exchange(frames, relabel(frames, bodies_of(cabinet)))) > 0.98


def test_a_wall_that_slides_in_itself_goes_as_one() -> None:
    """The side of a drawer fits the body and the drawer; its ends tell."""
    far = case(objects.cabinet(), step=45, points=2500)
    frames, T, labels = far
    bodies, drawer = bodies_of(far), 2  # it slides along y
    assert np.allclose(T[:, drawer, :3, :3], np.eye(3)) and np.abs(T[:, drawer, 1, 3]).max() > 5
    body = bodies[drawer]
    side = body.rows[(np.abs(body.normals[:, 0]) > 0.95) & (body.z[:, 0] > 0.9 * body.z[:, 0].max())]
    assert len(side) > 100
    lost = labels.copy()
    lost[side] = 0
    given = exchange(frames, make_bodies(frames, T, lost))
    back = np.mean(labels_of(given, len(labels))[side] == drawer)
    assert back > 0.85 and score(frames, given) < score(frames, make_bodies(frames, T, lost))


@pytest.mark.parametrize("move", [merge_bodies, split_bodies, sweep_bodies])
@pytest.mark.parametrize("seed", range(2))
def test_no_move_raises_the_score(move: Callable[..., Bodies], seed: int) -> None:
    found = case(objects.random_tree(4, seed=seed), points=900, seed=seed)
    frames, T, _ = found
    before = settled(frames, 2, make_bodies(frames, T, spoilt(found, 0.2, seed)), (0.4, 0.3))
    after = move(frames, 2, before)
    assert score(frames, after) <= score(frames, before) * 1.002


def test_right_from_wrong(hinge: Case) -> None:
    """Bodies that are cut and mixed are explained by two parts again."""
    frames, T, labels = hinge
    rng = np.random.default_rng(0)
    start = np.where(rng.random(len(labels)) < 0.1, 1 - labels, labels)
    start[(labels == 0) & (frames.points[:, 0] > np.median(frames.points[:, 0]))] = 2
    bodies = make_bodies(frames, np.concatenate([T, T[:, :1]], axis=1), start)
    found = explain(frames, 2, bodies, FitConfig())
    lowest = score(frames, found)
    assert len(found) == 2 and agreement(hinge, found) > 0.97
    assert lowest < score(frames, bodies)


def test_crumbs_go_to_their_neighbours(hinge: Case) -> None:
    frames, T, labels = hinge
    changed = labels.copy()
    changed[np.flatnonzero(labels == 1)[:10]] = 2
    bodies = make_bodies(frames, np.concatenate([T, T[:, :1]], axis=1), changed)
    kept = without_crumbs(frames, bodies)
    assert len(kept) == 2 and (labels_of(kept, len(labels)) >= 0).all()


def test_the_same_in_a_turned_world(hinge: Case) -> None:
    frames, T, labels = hinge
    turn = exp_se3(np.array([0.3, -0.8, 0.5, 4.0, -2.0, 7.0]))
    moved = make_frames([transform(turn, np.asarray(tree.data)) for tree in frames.trees])
    turned = make_bodies(moved, to_unit(turn @ T @ inverse(turn), moved.unit, moved.centre), labels[moved.order])
    assert score(moved, turned) == pytest.approx(score(frames, bodies_of(hinge)), rel=0.02)


def knife(slides: np.ndarray) -> Case:
    """A box, open at both ends, and a blade inside that slides along it."""
    rng, clouds, labels = np.random.default_rng(3), [], []
    for slide in slides:
        walls = np.column_stack([rng.uniform(-10, 10, 1600), np.zeros((1600, 2))])
        side, along = rng.integers(4, size=1600), rng.uniform(-2, 2, 1600)
        walls[:, 1] = np.select([side == 0, side == 1], [-2, 2], along)
        walls[:, 2] = np.select([side == 2, side == 3], [-2, 2], along)
        blade = np.column_stack([rng.uniform(-8, 8, 600) + slide, rng.uniform(-1.3, 1.3, 600), np.zeros(600)])
        clouds.append(np.concatenate([walls, blade]))
        labels.append(np.repeat([0, 1], [1600, 600]))
    frames = make_frames(clouds)
    T = np.tile(np.eye(4), (len(clouds), 2, 1, 1))
    T[:, 1, 0, 3] = (slides - slides[0]) / frames.unit
    return frames, T, np.concatenate(labels)[frames.order]


def test_a_blade_that_slides_in_itself_is_told_by_its_ends() -> None:
    found = knife(np.array([0.0, 3.0, 5.0, 2.0]))
    frames, T, labels = found
    lump = make_bodies(frames, T[:, :1], np.zeros_like(labels))
    (motion,) = slides(0, lump[0], frames.noise, screws(lump[0], None), 1, 0.0)
    assert np.abs(motion[:, :3, 3] - T[:, 1, :3, 3]).max() < 2.5  # spacings
    apart = split_bodies(frames, 0, lump)
    assert len(apart) == 2 and agreement(found, apart) > 0.99
    assert score(frames, apart) < 1.01 * score(frames, bodies_of(found)) < 0.95 * score(frames, lump)
    assert len(split_bodies(frames, 0, bodies_of(found))) == 2


def post_and_arm(turn: float) -> Case:
    """A post, nearly round about z, and an arm that turns by `turn` a frame about it."""
    rng, clouds, labels, step = np.random.default_rng(0), [], [], np.array([0, 0, turn, 0, 0, 0])
    for f in range(4):
        angle = rng.uniform(0, 2 * np.pi, 900)
        post = np.stack([0.1 * np.cos(angle), 0.085 * np.sin(angle), rng.uniform(0, 0.5, 900)], axis=1)
        arm = transform(exp_se3(f * step), rng.uniform([0.1, -0.05, 0.5], [0.6, 0.05, 0.5], (500, 3)))
        clouds.append(np.concatenate([post, arm]))
        labels.append(np.repeat([0, 1], [900, 500]))
    frames = make_frames(clouds)
    T = np.stack([np.tile(np.eye(4), (4, 1, 1)), exp_se3(np.outer(np.arange(4.0), step))], axis=1)
    return frames, to_unit(T, frames.unit, frames.centre), np.concatenate(labels)[frames.order]


def test_a_nearly_round_post_that_was_said_to_turn_with_its_arm_is_at_rest() -> None:
    found = post_and_arm(0.3)
    frames, T, labels = found
    one = make_bodies(frames, T[:, 1:], np.zeros_like(labels))
    apart = split_bodies(frames, 0, one)
    assert score(frames, apart) < score(frames, one)
    still = min(apart, key=lambda body: np.abs(body.T - np.eye(4)).max())
    assert (
        travel(still) < 0.5
        and (labels[still.rows] == 0).mean() > 0.9
        and (labels[still.rows] == 0).sum() > 0.8 * (labels == 0).sum()
    )
