"""The neural relaxed model finds parts and motions, repeats itself, and does not depend on the unit."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs rearticulate[paper]")

from scipy.spatial.distance import cdist

from oracle import in_spacings
from rearticulate.config import NeuralConfig
from rearticulate.geometry.nearest import search_tree
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.methods.paper.relax import cells, dissolve, relax_neural
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import make_frames
from rearticulate.parts.relaxed import Relaxed
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import hinge

CANONICAL = 1
QUICK = NeuralConfig(parts=6, chamfer_iterations=250, emd_iterations=50)


def silent(stage, fraction):
    pass


def recording(points=500, frames=4):
    """Frames of a hinge that turns, the flow between them without error, true labels (M,), true motion (F, 2, 4, 4)."""
    sequence, truth = record(hinge(), frames=frames, points=points, step_deg=15, seed=0)
    seen = make_frames(sequence.points)
    labels = np.concatenate(truth.labels)[seen.order]
    T = in_spacings(seen, truth.poses, CANONICAL)
    flow = []
    for f in range(frames - 1):
        here = seen.points[seen.rows(f)]
        step = T[f + 1] @ inverse(T[f])
        flow.append(SceneFlow(here, transform(step[labels[seen.rows(f)]], here) - here))
    return seen, flow, Relaxed(T, labels)


def fit(config=QUICK, seed=0, thing=None, start=None):
    frames, flow, _ = thing or recording()
    return relax_neural(frames, CANONICAL, flow, config, np.random.default_rng(seed), silent, start)


def motion_error(frames, model, truth):
    """Mean error of the moved canonical points, as a share of the object's diagonal."""
    gap = model.moved_points(frames, CANONICAL) - truth.moved_points(frames, CANONICAL)
    return np.linalg.norm(gap, axis=-1).mean() / np.linalg.norm(np.ptp(frames.points, axis=0))


def purity(labels, truth):
    """Share of the points whose part has mostly points of their true part; parts may be fragments of true ones."""
    table = np.zeros((labels.max() + 1, truth.max() + 1))
    np.add.at(table, (labels, truth), 1)
    return table.max(axis=1).sum() / len(labels)


@pytest.fixture(scope="module")
def found():
    thing = recording()
    return thing, fit(thing=thing)


def test_parts_and_motion_are_recovered(found):
    (frames, _, truth), model = found
    still = Relaxed(np.tile(np.eye(4), (frames.n_frames, 1, 1, 1)), np.zeros_like(truth.labels))
    assert motion_error(frames, still, truth) > 0.014
    assert motion_error(frames, model, truth) < 0.0035
    for f in range(frames.n_frames):
        rows = frames.rows(f)
        assert purity(model.labels[rows], truth.labels[rows]) > 0.95


def test_the_canonical_pose_is_the_identity(found):
    (frames, _, _), model = found
    np.testing.assert_array_equal(model.T[CANONICAL], np.tile(np.eye(4), (model.n_parts, 1, 1)))
    R = model.T[..., :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    assert model.T.shape[0] == frames.n_frames and model.labels.shape == (len(frames.points),)


def test_the_same_seed_gives_the_same_bits():
    config = replace(QUICK, chamfer_iterations=15, emd_iterations=10)
    a, b, c = (fit(config, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(a.T, b.T)
    np.testing.assert_array_equal(a.labels, b.labels)
    assert a.T.shape != c.T.shape or not np.array_equal(a.T, c.T)


def test_the_unit_of_the_frames_does_not_matter():
    config = replace(QUICK, chamfer_iterations=15, emd_iterations=10, minimum_points=1)
    frames, flow, truth = recording()
    points = 1024 * frames.points
    larger = replace(frames, points=points, trees=tuple(search_tree(points[frames.rows(f)]) for f in range(4)))
    a = fit(config, thing=(frames, flow, truth))
    b = fit(config, thing=(larger, [SceneFlow(1024 * p.anchors, 1024 * p.vectors) for p in flow], truth))
    np.testing.assert_array_equal(a.labels, b.labels)
    np.testing.assert_allclose(b.T[..., :3, 3], 1024 * a.T[..., :3, 3], rtol=1e-12)
    np.testing.assert_array_equal(b.T[..., :3, :3], a.T[..., :3, :3])


def test_frames_may_differ_in_size():
    clouds = [np.random.default_rng(f).normal(size=(n, 3)) for f, n in enumerate((90, 100, 70))]
    frames = make_frames(clouds)
    flow = [SceneFlow(frames.points[frames.rows(f)], np.zeros((len(clouds[f]), 3))) for f in range(2)]
    model = fit(replace(QUICK, chamfer_iterations=3, emd_iterations=3), thing=(frames, flow, None))
    assert model.labels.shape == (260,) and np.isfinite(model.T).all()


def misfit(frames, model):
    """Mean squared distance between the moved canonical points and the frames, both ways, in spacings squared."""
    clouds = [frames.points[frames.rows(f)] for f in range(frames.n_frames)]
    distances = [cdist(a, b, "sqeuclidean") for a, b in zip(model.moved_points(frames, CANONICAL), clouds, strict=True)]
    return np.mean([d.min(axis=0).mean() + d.min(axis=1).mean() for d in distances])


@pytest.mark.parametrize("terms", [t for t in product((False, True), repeat=3) if any(t)])
def test_every_set_of_energy_terms_explains_the_frames(terms):
    thing = recording(points=200)
    chamfer, emd, flow = (float(on) for on in terms)
    config = replace(QUICK, chamfer=chamfer, emd=emd, flow=flow, chamfer_iterations=100, emd_iterations=50)
    still = replace(config, chamfer_iterations=0, emd_iterations=0)
    before, after = (misfit(thing[0], fit(c, thing=thing)) for c in (still, config))
    assert after < 0.8 * before


@pytest.mark.parametrize(
    ("change", "error"), [({"field": False}, 0.008), ({"gumbel": False}, 0.014), ({"rate_end": 0.01}, 0.0045)]
)
def test_variants_of_the_model_explain_motion(change, error):
    thing = recording()
    model = fit(replace(QUICK, **change), thing=thing)
    assert motion_error(thing[0], model, thing[2]) < error


def test_a_given_model_is_where_the_fit_starts():
    thing = recording()
    frames, _, truth = thing
    nothing = replace(QUICK, chamfer_iterations=0, emd_iterations=0)
    model = fit(nothing, thing=thing, start=truth)
    np.testing.assert_allclose(model.T, truth.T, atol=1e-4)
    assert (model.labels == truth.labels).mean() > 0.97
    refined = fit(replace(QUICK, chamfer_iterations=30, emd_iterations=30, rate_end=0.0), thing=thing, start=truth)
    assert motion_error(frames, refined, truth) < 0.004


def test_progress_is_told_about_a_hundred_times():
    calls = []
    frames, flow, _ = recording(points=100, frames=3)
    config = replace(QUICK, chamfer_iterations=150, emd_iterations=100)
    rng = np.random.default_rng(0)
    relax_neural(frames, CANONICAL, flow, config, rng, lambda stage, fraction: calls.append((stage, fraction)))
    fractions = [fraction for _, fraction in calls]
    assert 90 < len(calls) < 140 and fractions == sorted(fractions)
    assert fractions[0] == 0.0 and fractions[-1] == 1.0 and {stage for stage, _ in calls} == {"relax"}


def test_small_parts_are_dissolved():
    frames, _, truth = recording()
    labels = truth.labels.copy()
    rows = np.flatnonzero(labels[frames.rows(CANONICAL)] == 0)[:5] + frames.start[CANONICAL]
    labels[rows] = 2
    T = np.concatenate([truth.T, exp_se3(np.ones((4, 1, 6)))], axis=1)
    model = dissolve(frames, CANONICAL, Relaxed(T, labels), minimum=20)
    assert model.n_parts == 2
    assert (model.labels == truth.labels).mean() > 0.999
    assert dissolve(frames, CANONICAL, truth, minimum=10_000).n_parts == 1


def test_cells_are_all_there_and_hold_what_is_nearest():
    points = np.random.default_rng(0).normal(size=(300, 3))
    labels = cells(points, 20)
    assert set(labels) == set(range(20))
    middle = np.stack([points[labels == k].mean(axis=0) for k in range(20)])
    spread = np.linalg.norm(points - middle[labels], axis=1).mean()
    assert spread < 0.6 * np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    assert set(cells(points[:3], 20)) == {0, 1, 2}


@pytest.mark.parametrize("start", ["cells", "random"])
def test_parts_are_found_from_either_start(start):
    frames, _, truth = recording()
    model = fit(replace(QUICK, start=start))
    assert purity(model.labels, truth.labels) > 0.97
    assert motion_error(frames, model, truth) < 0.0035
