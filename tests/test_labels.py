"""Labels: the mean field against plain numpy, plane cuts by hand, and the evidence of sheets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.joints.seams import best_cut
from rearticulate.observe.frames import make_frames
from rearticulate.observe.fused import surface_noise
from rearticulate.observe.misfit import evidence_frames
from rearticulate.parts.labels import (
    IMPOSSIBLE,
    SHEET_THICKNESS,
    Graph,
    Labeller,
    mean_field,
    nearest_evidence,
    part_distances,
    sheet_evidence,
    spatial_graph,
)


def plain_mean_field(unary, neighbour, weight, iterations):
    def softmax(z):
        e = np.exp(z - z.max(axis=1, keepdims=True))
        return e / e.sum(axis=1, keepdims=True)

    q = softmax(-np.minimum(unary - unary.min(axis=1, keepdims=True), 50.0))
    for _ in range(iterations):
        message = (weight[:, :, None] * q[neighbour]).sum(axis=1)
        q = 0.5 * q + 0.5 * softmax(message - unary)
    return q


@pytest.mark.parametrize("iterations", [1, 2, 7, 20])
def test_mean_field_equals_plain_numpy(iterations):
    rng = np.random.default_rng(0)
    unary = rng.uniform(0, 3, (40, 4))
    neighbour, weight = rng.integers(0, 40, (40, 6)), rng.uniform(0, 1, (40, 6))
    weight[rng.random((40, 6)) < 0.2] = 0.0
    found = mean_field(unary, Graph(neighbour, weight), iterations)
    np.testing.assert_allclose(found, plain_mean_field(unary, neighbour, weight, iterations), atol=1e-5)


def test_neighbours_outvote_a_weak_opinion_but_not_an_impossibility():
    unary = np.tile([0.0, 1.0], (5, 1))
    unary[0] = [0.4, 0.0]  # prefers part 1, all its neighbours prefer part 0
    star = Graph(np.array([[1, 2, 3, 4], [0] * 4, [0] * 4, [0] * 4, [0] * 4]), np.full((5, 4), 0.5))
    assert (mean_field(unary, star).argmax(axis=1) == 0).all()
    unary[0] = [IMPOSSIBLE, 0.0]
    found = mean_field(unary, star)
    assert found[0].argmax() == 1
    assert found[0, 0] < 1e-6


def test_joined_graphs_have_the_neighbours_of_both():
    a, b = Graph(np.array([[1], [0]]), np.ones((2, 1))), Graph(np.array([[0, 1], [1, 0]]), np.full((2, 2), 3.0))
    both = a.join(b, 0.5)
    np.testing.assert_array_equal(both.neighbour, [[1, 0, 1], [0, 1, 0]])
    np.testing.assert_array_equal(both.weight, [[1, 1.5, 1.5], [1, 1.5, 1.5]])


@pytest.mark.parametrize("F, limit, expected", [(3, 12, [0, 1, 2]), (9, 3, [0, 4, 8]), (1, 5, [0])])
def test_frames_of_the_evidence_are_evenly_spread(F, limit, expected):
    np.testing.assert_array_equal(evidence_frames(F, limit), expected)


def test_many_frames_are_thinned_to_the_limit():
    chosen = evidence_frames(100, 12)
    assert len(chosen) == 12
    assert (chosen[0], chosen[-1]) == (0, 99)
    assert set(np.diff(chosen)) <= {9, 10}  # to the rounding of 99 / 11


def test_a_cut_between_two_clear_sides():
    along = np.array([3.0, 0.0, 1.0, 2.0, 5.0, 4.0])
    favour = np.where(along >= 3, 1.0, -1.0)
    assert best_cut(along, favour, slack=0.5) == (2.5, 1.0)
    assert best_cut(along, -favour, slack=0.5) == (2.5, -1.0)


def test_a_cut_through_indifferent_points_lies_in_their_middle():
    along = np.arange(11.0)
    favour = np.concatenate([[-1.0, -1], np.zeros(7), [1.0, 1]])  # 2 to 8 do not care
    assert best_cut(along, favour, slack=0.5) == (5.0, 1.0)


def test_a_cut_ignores_a_single_outlier():
    along = np.arange(20.0)
    favour = np.where(along >= 12, 1.0, -1.0)
    favour[3] = 0.9
    assert best_cut(along, favour, slack=0.1) == (11.5, 1.0)


def test_when_all_points_favour_the_child_the_cut_is_below_them():
    place, side = best_cut(np.arange(4.0), np.ones(4), slack=0.5)
    assert (np.sign(np.arange(4.0) - place) == side).all()


def test_a_wider_slack_only_widens_the_range():
    along, favour = np.arange(10.0), np.repeat([-1.0, 1.0], 5)
    assert best_cut(along, favour, slack=2.0)[0] == 4.5  # symmetric: the middle stays
    assert best_cut(along, favour * np.where(along > 4, 3.0, 1.0), slack=2.0)[0] < 4.5  # the child's evidence is dearer


def two_plates(n=700, frames=6):
    """A plate at rest (x < 20) and one that turns about the line x = 20, sampled anew in every frame, no noise."""
    rng = np.random.default_rng(1)
    hinge = np.array([0, -1.0, 0, 0, 0, -20.0])  # about -y through (20, 0, 0)
    motion = exp_se3(0.12 * np.arange(frames)[:, None] * hinge)
    both = np.stack([np.tile(np.eye(4), (frames, 1, 1)), motion], axis=1)
    clouds, labels = [], []
    for f in range(frames):
        rest = np.column_stack([rng.uniform(0, 40, n), rng.uniform(0, 20, n), np.zeros(n)])
        labels.append((rest[:, 0] > 20).astype(int))
        clouds.append(transform(both[f, labels[-1]], rest))
    made = make_frames(clouds)
    return made, in_spacings(made, both), np.concatenate(labels)[made.order]


def agreement(evidence, labels, asked):
    """Share of the asked points whose lower cost is that of the true part."""
    return (evidence.argmin(axis=1) == labels)[asked].mean()


def test_the_test_motions_bring_every_point_back_to_one_plate():
    frames, T, labels = two_plates()
    z = transform(inverse(T)[frames.frame, labels], frames.points)
    assert np.ptp(z[:, 2]) < 1e-9


def test_sheets_prefer_the_true_motion():
    frames, T, labels = two_plates()
    everywhere = np.ones((len(labels), 2), bool)
    U = sheet_evidence(frames, T, everywhere, None)
    z = transform(inverse(T)[frames.frame, labels], frames.points)
    hinge = (20 - frames.centre[0]) / frames.unit
    away = (np.abs(z[:, 0] - hinge) > 8) & (frames.frame > 0)
    assert agreement(U, labels, away) > 0.97
    assert agreement(U[:, ::-1], labels, away) < 0.05


def test_nearest_points_prefer_the_true_motion_far_from_the_hinge():
    frames, T, labels = two_plates()
    everywhere = np.ones((len(labels), 2), bool)
    U = nearest_evidence(frames, T, everywhere, evidence_frames(6, 12))
    z = transform(inverse(T)[frames.frame, labels], frames.points)
    assert agreement(U, labels, np.abs(z[:, 0] - (20 - frames.centre[0]) / frames.unit) > 10) > 0.95


@pytest.mark.parametrize("evidence", ["sheet", "nearest"])
def test_what_is_no_candidate_is_impossible(evidence):
    frames, T, labels = two_plates(n=150, frames=3)
    candidates = np.ones((len(labels), 2), bool)
    candidates[::3, 1] = False
    if evidence == "sheet":
        U = sheet_evidence(frames, T, candidates, None)
    else:
        U = nearest_evidence(frames, T, candidates, evidence_frames(3, 12))
    np.testing.assert_array_equal(U == IMPOSSIBLE, ~candidates)
    np.testing.assert_array_equal(U[::3, 0], 0.0)  # nobody asks a point that has no choice


def test_disbelief_in_the_neighbours_weakens_a_sheet():
    frames, T, labels = two_plates(n=300, frames=4)
    everywhere = np.ones((len(labels), 2), bool)
    plain = sheet_evidence(frames, T, everywhere, None)
    sure = sheet_evidence(frames, T, everywhere, np.ones_like(plain))
    half = sheet_evidence(frames, T, everywhere, np.zeros_like(plain))
    np.testing.assert_allclose(sure, plain)
    np.testing.assert_allclose(half, plain / 2)
    assert plain.min() < -1


def test_candidates_are_the_parts_within_the_radius():
    line = np.column_stack([np.arange(30.0), np.zeros((30, 2))])
    frames = make_frames([line, line + np.array([0, 0.1, 0])])
    at = frames.points[:, 0] + 14.5  # spacing 1, centred
    labels = (at > 14.5).astype(int)
    distance = part_distances(frames, labels, 3, radius=3.2)
    np.testing.assert_array_equal(np.isfinite(distance[:, 0]), at < 17.7)
    np.testing.assert_array_equal(np.isfinite(distance[:, 1]), at > 11.3)
    np.testing.assert_allclose(distance[at < 14.5, 0], 0.0)
    assert np.isinf(distance[:, 2]).all()


def test_two_close_sheets_are_no_neighbours():
    rng = np.random.default_rng(2)
    low = np.column_stack([rng.uniform(0, 25, (600, 2)), np.zeros(600)])
    frames = make_frames([np.concatenate([low, low + np.array([0.3, 0.2, 2.5])])])
    frames = replace(frames, normals=np.tile([0.0, 0, 1], (1200, 1)))  # at this distance estimated normals mix both
    upper = frames.points[:, 2] > 0
    graph = spatial_graph(frames, scale=1.87, offset_scale=0.4)
    across = upper[graph.neighbour] != upper[:, None]
    assert across.any()
    assert graph.weight[across].max() < 1e-3
    assert np.median(graph.weight[~across]) > 0.05


@pytest.mark.parametrize(("noise", "expected"), [(0.0, 0.093), (0.25, 0.093), (0.35, np.sqrt(0.093**2 + 0.06))])
def test_sheets_are_thicker_by_the_noise(noise, expected):
    frames, _, _ = two_plates(n=150, frames=3)
    labeller = Labeller(frames)
    assert labeller.with_noise(noise).thickness == pytest.approx(expected)
    assert labeller.thickness == SHEET_THICKNESS  # the first one stays as it is


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.1])
def test_the_noise_of_a_surface_is_measured(noise):
    rng = np.random.default_rng(0)
    sheets = [np.column_stack([rng.uniform(0, 30, (900, 2)), rng.normal(0, noise, 900)]) for _ in range(6)]
    frames = make_frames(sheets)
    T, labels = np.tile(np.eye(4), (6, 1, 1, 1)), np.zeros(5400, dtype=int)
    measured = surface_noise(frames, 3, T, labels) * frames.unit
    assert noise <= measured <= np.sqrt(2) * noise  # two points differ by more than one; nearest ones by less than any
