"""`rearticulate pose`, `retarget` and `track`: what a user types, and what comes out."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from oracle import perfect_fit
from rearticulate.geometry.se3 import exp_se3
from rearticulate.io import load_result, load_sequence, load_truth, save_result
from rearticulate.io.model import load_sequence_of
from rearticulate.io.ply import read_cloud, read_header
from rearticulate.io.posture import load_posture, save_posture
from rearticulate.records import FitResult, Posture
from rearticulate.synth import bundled
from test_cli import one_line, run
from test_localization import C, mean_error, without
from test_spherical import ball_model
from toy_result import toy


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "lamp"
    save_result(folder, *toy(200))
    return folder


def cloud(path: Path) -> np.ndarray:
    return read_cloud(path, read_header(path))


@pytest.mark.parametrize(
    ("settings", "q"),
    [
        ([], [0, 0, 0]),
        (["arm=30deg"], [0, np.pi / 6, 0]),
        (["arm=-0.1", "tip=5cm"], [0, -0.1, 0.05]),
        (["arm = 10 °", "tip=1e1 mm"], [0, np.pi / 18, 0.01]),
        (["arm=50%", "tip=100%"], [0, 0.1, 0.06]),
    ],
)
def test_pose_moves_the_cloud_as_the_model_does(saved: Path, tmp_path: Path, settings: list[str], q: list) -> None:
    flags = [flag for setting in settings for flag in ("--joint", setting)]
    assert run("pose", saved, *flags, "-o", tmp_path / "cloud.ply").exit_code == 0
    model = load_result(saved).model
    np.testing.assert_allclose(cloud(tmp_path / "cloud.ply"), model.pose(np.array(q)), atol=1e-12)


def test_a_pose_starts_from_a_frame_or_a_file(saved: Path, tmp_path: Path) -> None:
    result = load_result(saved)
    file = tmp_path / "there.json"
    assert run("pose", saved, "--frame", 3, "--joint", "tip=0", "-o", file).exit_code == 0
    posture = load_posture(file, result.model)
    np.testing.assert_array_equal(posture.q, [0, result.motion.q[3, 1], 0])
    done = run("pose", saved, "--from", file, "-o", tmp_path / "cloud.ply", "--json")
    assert json.loads(done.stdout)["joints"] == {"arm": result.motion.q[3, 1], "tip": 0.0}
    np.testing.assert_allclose(cloud(tmp_path / "cloud.ply"), result.model.pose(posture.q), atol=1e-12)


def test_a_dense_pose_has_the_points_of_all_frames(saved: Path, tmp_path: Path) -> None:
    assert run("pose", saved, "--dense", "-o", tmp_path / "cloud.ply").exit_code == 0
    assert len(cloud(tmp_path / "cloud.ply")) > 3 * 600


def test_beyond_the_observed_range_is_told(saved: Path, tmp_path: Path) -> None:
    done = run("pose", saved, "--joint", "arm=90deg", "-o", tmp_path / "cloud.ply")
    assert done.exit_code == 0 and "arm = 1.57 rad is beyond what was observed, -0.2 to 0.4 rad" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--joint", "arm"], "write NAME=VALUE"),
        (["--joint", "leg=1"], "no joint is called 'leg'; the joints are arm, tip"),
        (["--joint", "base=1"], "no joint is called 'base'"),
        (["--joint", "arm=2cm"], "a revolute joint takes a number with or without one of rad, deg, °, %"),
        (["--joint", "tip=2deg"], "a prismatic joint takes a number with or without one of m, cm, mm, %"),
        (["--joint", "arm=1,2,3"], "a revolute joint takes one value"),
        (["--joint", "arm=nan"], "takes a number"),
        (["--frame", "4"], "the result has frames 0 to 3"),
        (["--frame", "1", "--from", "x.json"], "give --frame or --from, not both"),
        (["--from", "x.json"], "x.json: no such file"),
    ],
)
def test_bad_postures_are_one_line(saved: Path, tmp_path: Path, arguments: list[str], what: str) -> None:
    done = run("pose", saved, *arguments, "-o", tmp_path / "cloud.ply")
    assert done.exit_code == 2 and what in one_line(done)
    assert not (tmp_path / "cloud.ply").exists()


def test_other_suffixes_are_one_line(saved: Path, tmp_path: Path) -> None:
    assert "written as .ply" in one_line(run("pose", saved, "-o", tmp_path / "cloud.stl"))


def test_a_file_is_replaced_only_when_asked(saved: Path, tmp_path: Path) -> None:
    file = tmp_path / "cloud.ply"
    file.write_text("mine")
    assert "exists; name another file" in one_line(run("pose", saved, "-o", file))
    assert file.read_text() == "mine"
    assert run("pose", saved, "-o", file, "--overwrite").exit_code == 0 and len(cloud(file)) > 0
    (tmp_path / "folder.ply").mkdir()
    assert "is a folder" in one_line(run("pose", saved, "-o", tmp_path / "folder.ply", "--overwrite"))


def test_postures_survive_the_file(tmp_path: Path) -> None:
    for model in (toy()[0].model, ball_model()):
        rng = np.random.default_rng(0)
        q = rng.normal(size=model.n_values)
        q[0] = 0.0
        posture = Posture(q, exp_se3(rng.normal(size=6)))
        save_posture(tmp_path / "p.json", model, posture, note="anything")
        back = load_posture(tmp_path / "p.json", model)
        np.testing.assert_array_equal(back.q, q)
        np.testing.assert_array_equal(back.T_world_root, posture.T_world_root)


@pytest.mark.parametrize(
    ("record", "what"),
    [
        ([1, 2], 'not a posture, it has no "joints"'),
        ({"joints": {"leg": 1}}, "no joint is called 'leg'"),
        ({"joints": {"arm": "far"}}, "arm must be a finite number"),
        ({"joints": {"arm": [1, 2]}}, "arm must be a finite number"),
        ({"joints": {}, "T_world_root": [[1, 2], [3, 4]]}, "T_world_root must be finite numbers of shape 4 x 4"),
        ({"joints": {}, "T_world_root": np.diag([2.0, 2, 2, 1]).tolist()}, "T_world_root is not a rigid motion"),
    ],
)
def test_damaged_postures_are_one_line(saved: Path, tmp_path: Path, record: object, what: str) -> None:
    (tmp_path / "p.json").write_text(json.dumps(record))
    assert what in one_line(run("pose", saved, "--from", tmp_path / "p.json", "-o", tmp_path / "c.ply"))


def clicks_at(result: FitResult, first: Posture, last: Posture, rows: list[int], parts: bool = False) -> dict:
    """Points of the cloud in one posture, and where they are in another."""
    model = result.model
    source, target = (model.pose(p.q, p.T_world_root)[rows] for p in (first, last))
    clicks = [{"source": s, "target": t} for s, t in zip(source.tolist(), target.tolist(), strict=True)]
    if parts:
        for click, row in zip(clicks, rows, strict=True):
            click["part"] = model.names[model.labels[row]]
    return {"clicks": clicks}


@pytest.mark.parametrize("parts", [False, True], ids=["nearest", "named"])
@pytest.mark.parametrize("frame", [None, 3])
def test_retarget_brings_the_clicks_where_they_should_be(
    saved: Path, tmp_path: Path, frame: int | None, parts: bool
) -> None:
    result = load_result(saved)
    first = Posture.rest(result.model) if frame is None else result.motion.posture(frame)
    last = Posture(np.array([0.0, -0.25, 0.02]), np.eye(4))
    rows = [int(np.flatnonzero(result.model.labels == p)[k]) for p in (1, 2) for k in (3, 30, 90)]
    (tmp_path / "clicks.json").write_text(json.dumps(clicks_at(result, first, last, rows, parts)))
    start = [] if frame is None else ["--frame", frame]
    out = tmp_path / "out"
    done = run("retarget", saved, tmp_path / "clicks.json", "-o", out, "--fixed-root", *start, "--json")
    told = json.loads(done.stdout)
    assert max(click["residual"] for click in told["clicks"]) < 1e-4
    assert told["joints"] == pytest.approx({"arm": -0.25, "tip": 0.02}, abs=1e-3)
    assert [click["part"] for click in told["clicks"]] == ["arm"] * 3 + ["tip"] * 3
    found = load_posture(out / "posture.json", result.model)
    np.testing.assert_allclose(cloud(out / "cloud.ply"), result.model.pose(found.q, found.T_world_root), atol=1e-12)
    with open(out / "motion.csv", newline="") as file:
        way = list(csv.DictReader(file))
    assert float(way[0]["arm [rad]"]) == first.q[1] and float(way[-1]["arm [rad]"]) == pytest.approx(found.q[1])
    with Image.open(out / "animation.gif") as clip:
        assert clip.n_frames == 2 * len(way) - 2


def test_joints_that_nothing_constrains_stay(saved: Path, tmp_path: Path) -> None:
    result = load_result(saved)
    first = result.motion.posture(3)
    last = Posture(np.array([0.0, 0.1, first.q[2]]), np.eye(4))
    rows = np.flatnonzero(result.model.labels == 1)[[3, 30, 90]].tolist()
    (tmp_path / "clicks.json").write_text(json.dumps(clicks_at(result, first, last, rows)))
    done = run("retarget", saved, tmp_path / "clicks.json", "-o", tmp_path / "out", "--frame", 3, "--fixed-root")
    assert done.exit_code == 0
    found = load_posture(tmp_path / "out" / "posture.json", result.model)
    np.testing.assert_allclose(found.q, last.q, atol=1e-3)


@pytest.mark.parametrize(
    ("record", "what"),
    [
        ({"clicks": []}, "no clicks; give"),
        ([1], "no clicks; give"),
        ({"clicks": [{"source": [0, 0, 0], "target": [0, 0, 0]}] * 2001}, "2001 clicks, at most 2000"),
        ({"clicks": [3]}, 'click 0 must have "source" and "target"'),
        ({"clicks": [{"source": [0, 0, 0]}]}, "target of click 0 must be finite numbers of shape 3"),
        (
            {"clicks": [{"source": [0, 0, "x"], "target": [0, 0, 0]}]},
            "source of click 0 must be finite numbers",
        ),
        ({"clicks": [{"source": [0, 0, 0], "target": [0, 0, 0], "part": "leg"}]}, "no part is called 'leg'"),
        ({"clicks": [{"source": [0, 0, 0], "target": [0, 0, 0], "part": 1}]}, "part of click 0 must be the name"),
    ],
)
def test_bad_clicks_are_one_line(saved: Path, tmp_path: Path, record: object, what: str) -> None:
    (tmp_path / "clicks.json").write_text(json.dumps(record))
    done = run("retarget", saved, tmp_path / "clicks.json", "-o", tmp_path / "out")
    assert done.exit_code == 2 and what in one_line(done)
    assert not (tmp_path / "out").exists()


def test_a_retargeting_is_replaced_only_when_asked(saved: Path, tmp_path: Path) -> None:
    click = {"source": [0.3, 0, 0], "target": [0.3, 0.05, 0]}
    (tmp_path / "clicks.json").write_text(json.dumps({"clicks": [click]}))
    arguments = ("retarget", saved, tmp_path / "clicks.json", "-o", tmp_path / "out")
    assert run(*arguments).exit_code == 0
    assert "holds an earlier retargeting" in one_line(run(*arguments))
    assert run(*arguments, "--overwrite").exit_code == 0


def test_track_writes_a_result_of_the_new_scans(tmp_path: Path) -> None:
    sequence = load_sequence(bundled.path("so101"))
    result = perfect_fit(sequence, load_truth(bundled.truth_path("so101")), C)
    save_result(tmp_path / "arm", *without(result, sequence, [9]))
    np.savetxt(tmp_path / "new scan.xyz", sequence.points[9])
    done = run("track", tmp_path / "arm", tmp_path / "new scan.xyz", "-o", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)["scans"][0]
    assert told["name"] == "new scan.xyz"
    q = [0.0, *told["joints"].values()]
    T_found = result.model.forward(np.array(q), np.array(told["T_world_root"]))
    assert mean_error(result, T_found, result.model.forward(result.motion.q[9])) < 0.01
    whole = load_result(tmp_path / "out")
    assert len(whole.motion.q) == 2 and whole.model.canonical == 0
    np.testing.assert_array_equal(whole.motion.q[0], 0.0)
    np.testing.assert_array_equal(whole.motion.q[1], q)
    assert (whole.labels[1] == result.labels[9]).mean() > 0.9
    colored = tmp_path / "out" / "scans" / "000_new_scan.ply"
    np.testing.assert_allclose(cloud(colored), sequence.points[9], atol=1e-9)
    assert load_posture(colored.with_suffix(".json"), result.model).q.tolist() == q
    assert (tmp_path / "out" / "report.html").exists()


def test_a_scan_of_something_else_is_told(saved: Path, tmp_path: Path) -> None:
    points = load_sequence_of(saved).points[0]
    np.savetxt(tmp_path / "same.xyz", points)
    size = np.ptp(points, axis=0)
    np.savetxt(tmp_path / "other.xyz", points[0] + 3 * np.linalg.norm(size) * np.random.default_rng(0).random((200, 3)))
    for name, strange in (("same", False), ("other", True)):
        done = run("track", saved, tmp_path / f"{name}.xyz", "-o", tmp_path / name, "--no-report")
        assert done.exit_code == 0, done.stderr
        assert (f"warning: {name}.xyz: its points lie" in done.stderr) == strange
        assert (tmp_path / name / "model.json").exists()


def test_scans_that_cannot_be_used_are_one_line(saved: Path, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "few.xyz", np.random.default_rng(0).normal(size=(20, 3)))
    done = run("track", saved, tmp_path / "few.xyz", "-o", tmp_path / "out")
    assert done.exit_code == 2 and "few.xyz: 20 point(s), a frame needs at least 100" in one_line(done)
    assert "no such file" in one_line(run("track", saved, tmp_path / "none.xyz", "-o", tmp_path / "out"))
    assert not (tmp_path / "out").exists()
