"""Whole fits of small clouds: exact answers, and what must not change them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from oracle import read_pair
from rearticulate import pipeline
from rearticulate.config import FitConfig
from rearticulate.errors import InputError
from rearticulate.evaluation.clustering import rand_index
from rearticulate.evaluation.metrics import evaluate
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.io.stages import StageStore
from rearticulate.methods import direct
from rearticulate.pipeline import canonical_frames, fit, working_rows
from rearticulate.records import PointSequence
from rearticulate.synth import objects
from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder, record
from rearticulate.synth.surfaces import box

QUICK = FitConfig(canonical_tries=1)


def scores(result, truth, sequence):
    return {m.key: m.value for m in evaluate(result, truth, sequence)}


def lift() -> ArticulatedObject:
    """A post that slides up from a base."""
    build = ObjectBuilder("base", box((0.4, 0.3, 0.1)))
    build.add("post", box((0.12, 0.16, 0.3), (0.05, 0, 0.22)), 0, "prismatic", axis=(0.2, 0, 1), limits=(0.0, 0.5))
    return build.build()


@pytest.fixture(scope="module")
def hinge():
    return record(objects.hinge(), frames=6, points=1500, step_deg=12, seed=1)


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    return StageStore(tmp_path_factory.mktemp("stages"))


@pytest.fixture(scope="module")
def fitted(hinge, stages):
    return fit(hinge[0], QUICK, store=stages)


def assert_exact(found, result, truth):
    assert found["parts"] == found["parts_true"]
    assert found["tree_edit_distance"] == 0
    assert found["joint_type_share"] == 1
    assert found["joint_axis_median_deg"] < 1
    assert found.get("joint_position_median_percent", 0.0) < 1
    assert found["rand_index_multi_scan"] >= 0.96
    assert found["recon_cm"] < 0.2
    assert all(joint.determined for joint in result.joints)


def test_a_hinge(hinge, fitted):
    sequence, truth = hinge
    found = scores(fitted, truth, sequence)
    assert_exact(found, fitted, truth)
    assert found["rand_index"] >= 0.97
    span = np.ptp(truth.joint_state[:, 1])
    assert fitted.joints[1].observed_range == pytest.approx(span, abs=0.02)
    q = np.abs(fitted.motion.q[:, 1])
    state = truth.joint_state[:, 1]
    np.testing.assert_allclose(q, np.abs(state - state[fitted.model.canonical]), atol=0.02)


def test_a_result_is_in_order(hinge, fitted):
    model, motion = fitted.model, fitted.motion
    assert model.canonical == 3
    np.testing.assert_array_equal(model.points, hinge[0].points[3])
    np.testing.assert_array_equal(model.labels, fitted.labels[3])
    np.testing.assert_array_equal(motion.q[3], 0)
    np.testing.assert_allclose(motion.T_world_root[3], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(model.limits, np.stack([motion.q.min(axis=0), motion.q.max(axis=0)], axis=1))
    assert [len(part) for part in fitted.labels] == [1500] * 6
    assert fitted.residual.shape == (6,) and fitted.residual.max() < 0.02
    assert list(fitted.energies) == [3]
    assert {"prepare", "track", "segment", "articulate", "finish"} <= {stage.name for stage in fitted.stages}


@pytest.mark.parametrize("make, moving", [(lift, False), (lambda: objects.arm(2), True)], ids=["lift", "arm"])
def test_other_mechanisms(make, moving):
    sequence, truth = record(make(), frames=6, points=1500, step_deg=12, moving_root=moving, seed=1)
    result = fit(sequence, QUICK)
    assert_exact(scores(result, truth, sequence), result, truth)


def test_a_rigid_body_has_one_part_and_no_joints():
    sequence, truth = record(objects.rigid(), frames=5, points=1200, moving_root=True, seed=1)
    result = fit(sequence, QUICK)
    assert result.model.joint_type == ("floating",)
    assert scores(result, truth, sequence)["recon_cm"] < 0.2
    assert all((part == 0).all() for part in result.labels)


def test_a_spinning_rod_has_no_sure_joint():
    sequence, _ = record(objects.spinning_rod(), frames=6, points=1500, step_deg=12, seed=1)
    result = fit(sequence, QUICK)
    assert not any(joint.determined for joint in result.joints[1:])
    assert result.residual.max() < 0.03


def assert_same(a, b):
    np.testing.assert_array_equal(np.concatenate(a.labels), np.concatenate(b.labels))
    for name in ("q", "T_world_root"):
        np.testing.assert_array_equal(getattr(a.motion, name), getattr(b.motion, name))
    for name in ("parent", "axis", "origin", "limits"):
        np.testing.assert_array_equal(getattr(a.model, name), getattr(b.model, name))
    assert a.joints == b.joints
    assert a.energy == b.energy


def test_the_same_seed_gives_the_same_bits(hinge, fitted):
    assert_same(fit(hinge[0], QUICK), fitted)


def test_a_stopped_fit_goes_on_where_it_was(hinge, stages, fitted, monkeypatch):
    def never(*args):
        raise AssertionError("this half of the fit was done already")

    monkeypatch.setattr(direct, "relax", never)
    monkeypatch.setattr(direct, "articulate", never)
    assert_same(fit(hinge[0], QUICK, store=stages), fitted)
    for other in ({"seed": 1}, {"config": replace(QUICK, working_points=4999)}):
        with pytest.raises(AssertionError, match="done already"):
            fit(hinge[0], **{"config": QUICK, "store": stages, **other})


def test_a_stage_of_another_version_or_other_contents_is_none(hinge, stages, fitted, monkeypatch):
    mark = pipeline.fingerprint(hinge[0], QUICK, 0)
    for version, code in (("0.0.1", pipeline.code_hash()), (pipeline.package_version(), "0" * 12)):
        with monkeypatch.context() as patch:
            patch.setattr(pipeline, "package_version", lambda version=version: version)
            patch.setattr(pipeline, "code_hash", lambda code=code: code)
            assert pipeline.fingerprint(hinge[0], QUICK, 0) != mark
    key = f"articulated-{fitted.model.canonical}"
    whole = stages.load(key, mark)
    spoiled = [
        {"labels": whole["labels"][1:]},
        {"q": whole["q"][:, :1]},
        {"more": np.zeros(1)},
        {"energy": np.str_("")},
    ]
    for change in spoiled:
        stages.save(key, mark, {**whole, **change})
        with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
            patch.setattr(direct, "articulate", lambda *args: 1 / 0)
            fit(hinge[0], QUICK, store=stages)
    stages.save(key, mark, whole)


def shared(a, b):
    return rand_index(np.concatenate(a.labels), np.concatenate(b))


def test_the_order_of_the_points_does_not_matter(hinge, fitted):
    rng = np.random.default_rng(0)
    orders = [rng.permutation(len(p)) for p in hinge[0].points]
    result = fit(PointSequence.from_arrays([p[o] for p, o in zip(hinge[0].points, orders, strict=True)]), QUICK)
    undone = [part[np.argsort(o)] for part, o in zip(result.labels, orders, strict=True)]
    assert shared(fitted, undone) > 0.99
    np.testing.assert_array_equal(result.model.parent, fitted.model.parent)
    np.testing.assert_allclose(np.abs(result.motion.q), np.abs(fitted.motion.q), atol=0.01)


def test_the_unit_and_the_place_of_the_world_do_not_matter(hinge, fitted):
    T = exp_se3(np.array([0.4, -1.0, 2.0, 10.0, 20.0, -5.0]))
    result = fit(PointSequence.from_arrays([1000 * transform(T, p) for p in hinge[0].points]), QUICK)
    assert result.model.joint_type == fitted.model.joint_type
    np.testing.assert_array_equal(result.model.parent, fitted.model.parent)
    np.testing.assert_allclose(np.abs(result.motion.q), np.abs(fitted.motion.q), atol=0.02)
    assert shared(fitted, result.labels) > 0.98
    origin = transform(T, fitted.model.origin[1])
    away = np.cross(result.model.origin[1] / 1000 - origin, T[:3, :3] @ fitted.model.axis[1])
    assert np.linalg.norm(away) < 0.005
    assert abs(result.model.axis[1] @ T[:3, :3] @ fitted.model.axis[1]) > np.cos(np.deg2rad(1))


@pytest.mark.parametrize("canonical", [-1, 6, 100])
def test_a_canonical_frame_that_does_not_exist(hinge, canonical):
    with pytest.raises(InputError, match=f"canonical frame {canonical} does not exist.*0 to 5"):
        fit(hinge[0], QUICK, canonical=canonical)


def test_canonical_frames_are_tried_from_the_middle():
    config = FitConfig(canonical_tries=4, canonical_work=82_000)

    def tried(F, points, **changes):
        return canonical_frames(np.full(F, points), None, replace(config, **changes))

    assert tried(10, 4096) == [5, 4]
    assert tried(4, 4096) == [2, 1, 3, 0]
    assert tried(2, 4096) == [1, 0]
    assert tried(10, 1024) == [5, 4, 6, 3]  # sparse: each costs less
    assert tried(10, 4096, canonical_tries=1) == [5]
    assert canonical_frames(np.full(10, 4096), 9, config) == [9]


def test_canonical_frames_are_those_that_show_most():
    counts = np.array([691, 616, 708, 738, 733, 594, 571, 498, 478, 495])
    assert canonical_frames(counts, None, FitConfig()) == [4, 3, 2, 0]
    assert canonical_frames(np.array([1000, 950, 901, 1000]), None, FitConfig()) == [2, 1, 3, 0]
    cover = np.array([0.9, 0.9, 0.9, 0.8, 0.8, 0.6, 0.7, 0.7, 0.7, 0.7])  # the points of an end that came near
    assert canonical_frames(counts, None, FitConfig(), cover) == [4, 6, 3, 7]


def test_large_frames_are_thinned_evenly():
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(working_rows(50, 50, rng), np.arange(50))
    rows = working_rows(1000, 100, rng)
    assert len(np.unique(rows)) == 100
    assert (np.diff(rows) > 0).all() and rows[0] >= 0 and rows[-1] < 1000


def test_a_real_sequence(data_folder):
    sequence, truth = read_pair(data_folder / "household" / "sink_cabinet.npz")
    result = fit(sequence, QUICK)
    found = scores(result, truth, sequence)
    assert found["tree_edit_distance"] == 0
    assert found["recon_cm"] <= 0.2
