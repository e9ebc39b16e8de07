"""Sheets of points, their noise, parts near a point, and plane cuts by hand."""

from __future__ import annotations

import numpy as np
import pytest

from oracle import in_spacings
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.joints.seams import best_cut
from rearticulate.observe.frames import make_frames
from rearticulate.observe.fused import surface_noise
from rearticulate.observe.misfit import evidence_frames
from rearticulate.parts.sheets import IMPOSSIBLE, part_distances, sheet_evidence, sheet_thickness


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
    U = sheet_evidence(frames, T, everywhere)
    z = transform(inverse(T)[frames.frame, labels], frames.points)
    hinge = (20 - frames.centre[0]) / frames.unit
    away = (np.abs(z[:, 0] - hinge) > 8) & (frames.frame > 0)
    assert agreement(U, labels, away) > 0.97
    assert agreement(U[:, ::-1], labels, away) < 0.05


def test_what_is_no_candidate_is_impossible():
    frames, T, labels = two_plates(n=150, frames=3)
    candidates = np.ones((len(labels), 2), bool)
    candidates[::3, 1] = False
    U = sheet_evidence(frames, T, candidates)
    np.testing.assert_array_equal(U == IMPOSSIBLE, ~candidates)
    np.testing.assert_array_equal(U[::3, 0], 0.0)  # nobody asks a point that has no choice


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


@pytest.mark.parametrize(("noise", "expected"), [(0.0, 0.093), (0.25, 0.093), (0.35, np.sqrt(0.093**2 + 0.06))])
def test_sheets_are_thicker_by_the_noise(noise, expected):
    assert sheet_thickness(noise) == pytest.approx(expected)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.1])
def test_the_noise_of_a_surface_is_measured(noise):
    rng = np.random.default_rng(0)
    sheets = [np.column_stack([rng.uniform(0, 30, (900, 2)), rng.normal(0, noise, 900)]) for _ in range(6)]
    frames = make_frames(sheets)
    T, labels = np.tile(np.eye(4), (6, 1, 1, 1)), np.zeros(5400, dtype=int)
    measured = surface_noise(frames, 3, T, labels) * frames.unit
    assert noise <= measured <= np.sqrt(2) * noise  # two points differ by more than one; nearest ones by less than any
