"""The bundled sequences: small, complete, and their ground truth fits their points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from oracle import assert_joints_explain_poses
from rearticulate.errors import InputError
from rearticulate.geometry.se3 import transform
from rearticulate.io.sequence import load_sequence
from rearticulate.io.truth import load_truth
from rearticulate.synth import bundled


def test_three_small_sequences_come_with_the_package():
    assert bundled.names() == ["g1", "sideboard", "so101"]
    folder = bundled.path("g1").parent
    assert sum(file.stat().st_size for file in folder.iterdir()) < 2_000_000
    described = (folder / "README.md").read_text()
    assert all(f"| `{name}` |" in described for name in bundled.names())


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(InputError, match="g1, sideboard, so101"):
        bundled.path("atlas")


@pytest.mark.parametrize("name", bundled.names())
def test_truth_moves_each_part_onto_the_last_frame(name):
    sequence, truth = load_sequence(bundled.path(name)), load_truth(bundled.truth_path(name))
    last = len(sequence) - 1
    distances = []
    for p in range(len(truth.parent)):
        first = sequence.points[0][truth.labels[0][sequence.index[0]] == p]
        there = sequence.points[last][truth.labels[last][sequence.index[last]] == p]
        distances.append(cKDTree(there).query(transform(truth.poses[last, p], first))[0])
    spacing = np.median(cKDTree(sequence.points[0]).query(sequence.points[0], k=2)[0][:, 1])
    assert np.median(np.concatenate(distances)) < 1.5 * spacing


@pytest.mark.parametrize("name", bundled.names())
def test_every_joint_moves_as_the_truth_says(name):
    truth = load_truth(bundled.truth_path(name))
    assert (np.ptp(truth.joint_state[:, 1:], axis=0) > 0.05).all()
    assert_joints_explain_poses(truth)
