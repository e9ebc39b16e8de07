"""Pictures without a display: where points land, what hides what, and files that play."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rearticulate.geometry.se3 import exp_se3, log_se3
from rearticulate.io import save_result
from rearticulate.posing.blend import between_frames, blend, eased
from rearticulate.records import Posture
from rearticulate.render.camera import View, upright
from rearticulate.render.canvas import INK, Canvas, eye_dome
from rearticulate.render.clip import there_and_back
from rearticulate.render.panels import PANELS, novel_posture
from rearticulate.render.viewpoint import best_view
from test_cli import one_line, run
from test_spherical import ball_model
from toy_result import FRAMES, toy


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "lamp"
    save_result(folder, *toy(200))
    return folder


CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_up_is_up(up: str) -> None:
    R = upright(up)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    axis = np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    np.testing.assert_allclose(R @ axis, [0, 0, 1], atol=1e-12)
    camera = View(20.0, 10.0, up).camera([CUBE], (100, 100))
    (_, y0), (_, y1) = camera.project(np.stack([0 * axis, axis]))[0]
    assert y1 < y0


@pytest.mark.parametrize("pixels", [(100, 100), (200, 80), (60, 120)])
def test_everything_is_in_the_picture_and_fills_it(pixels: tuple[int, int]) -> None:
    cloud = np.random.default_rng(0).normal(size=(500, 3)) * [3, 1, 0.5] + 7
    at, _ = View().camera([cloud], pixels).project(cloud)
    assert (at >= 0).all() and (at <= pixels).all()
    assert (np.ptp(at, axis=0) / pixels).max() > 0.55


def test_the_nearer_point_hides_the_other_whatever_their_order() -> None:
    view = View(0.0, 0.0)  # the eye is on +x
    pair = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    colors = np.array([[250.0, 0, 0], [0, 0, 250.0]])
    for order in ([0, 1], [1, 0]):
        canvas = Canvas(view.camera([CUBE], (50, 50)))
        canvas.points(pair[order], colors[order], 4.0)
        red, _, blue = canvas.picture().getpixel((25, 25))
        assert red > 200 > blue
    assert canvas.picture().getpixel((2, 2)) == (255, 255, 255)


def test_lines_lie_on_top() -> None:
    canvas = Canvas(View(0.0, 0.0).camera([CUBE], (50, 50)))
    canvas.points(np.array([[1.0, 0, 0]]), np.array([250.0, 0, 0]), 6.0)
    canvas.line(np.array([[-1.0, -1, 0], [-1.0, 1, 0]]), INK, 3.0)
    assert canvas.picture().getpixel((25, 25)) == INK


def test_eye_dome_darkens_behind_edges_only() -> None:
    depth = np.full((20, 20), 0.0)
    depth[:, 10:] = 0.5
    depth[:3] = -np.inf
    light = eye_dome(depth, 1)
    assert (light[:3] == 1).all() and (light[5:, :9] == 1).all() and (light[5:, 10:] == 1).all()
    assert (light[5:, 9] < 0.9).all()


def test_the_best_view_shows_the_door() -> None:
    rng = np.random.default_rng(0)
    box = rng.uniform(-1, 1, (3000, 3))
    box[np.arange(3000), rng.integers(0, 3, 3000)] = rng.choice([-1.0, 1.0], 3000)
    result, sequence = toy()
    for turn in (0, 90, 180, 270):
        side = np.array([np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn)), 0.0])
        labels = (box @ side > 0.99).astype(int)
        own, frames = replace(result, labels=(labels,) * FRAMES), (box,) * FRAMES
        view = best_view(own, replace(sequence, points=frames))
        assert view.R[2] @ side > 0.5


def test_a_new_posture_stays_in_the_observed_ranges() -> None:
    for model in (toy()[0].model, ball_model()):
        q = novel_posture(model).q
        for j in range(1, model.n_parts):
            value = np.linalg.norm(q[model.values(j)]) if model.joint_type[j] == "spherical" else q[j]
            assert model.limits[j, 0] - 1e-12 <= value <= model.limits[j, 1] + 1e-12
        assert q.any()


def test_blends_start_and_end_where_they_should_and_turn_evenly() -> None:
    model = toy()[0].model
    rng = np.random.default_rng(1)
    a = Posture(rng.normal(size=3), exp_se3(rng.normal(size=6) * 0.3))
    b = Posture(rng.normal(size=3), exp_se3(rng.normal(size=6) * 0.3))
    way = blend(a, b, np.array([0.0, 0.5, 1.0]))
    for k, end in ((0, a), (2, b)):
        np.testing.assert_allclose(way.q[k], end.q, atol=1e-12)
        np.testing.assert_allclose(way.T_world_root[k], end.T_world_root, atol=1e-12)
    first, second = (np.linalg.inv(way.T_world_root[k]) @ way.T_world_root[k + 1] for k in (0, 1))
    np.testing.assert_allclose(np.abs(log_se3(first)), np.abs(log_se3(second)), atol=1e-9)
    assert model.n_values == 3 and eased(5)[[0, -1]].tolist() == [0.0, 1.0] and (np.diff(eased(9)) > 0).all()


def test_play_passes_through_the_frames() -> None:
    motion = toy()[0].motion
    found = between_frames(motion, np.array([-1.0, 0.0, 1.5, 3.0, 9.0]))
    expected = [motion.q[0], motion.q[0], (motion.q[1] + motion.q[2]) / 2, motion.q[3], motion.q[3]]
    np.testing.assert_allclose(found.q, expected, atol=1e-12)


def test_there_and_back_has_no_jump() -> None:
    assert there_and_back([1, 2, 3, 4]) == [1, 2, 3, 4, 3, 2]  # type: ignore[list-item]
    assert there_and_back([1, 2]) == [1, 2]  # type: ignore[list-item]


def test_a_gif_plays_and_is_white_where_nothing_is(saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "clip.gif"
    assert run("render", saved, "-o", out, "--size", 80).exit_code == 0
    with Image.open(out) as clip:
        assert clip.n_frames == 2 * (4 * 3 + 1) - 2
        assert clip.size == (80 * len(PANELS), 80 + 22)
        pictures = []
        for k in (0, 12):
            clip.seek(k)
            pictures.append(np.asarray(clip.convert("RGB"), dtype=int))
    assert (pictures[0][2, 2] == 255).all()
    assert np.abs(pictures[0] - pictures[1])[:80].max() > 50


def test_an_mp4_plays(saved: Path, tmp_path: Path) -> None:
    import av

    out = tmp_path / "clip.mp4"
    posture = tmp_path / "p.json"
    assert run("pose", saved, "--joint", "arm=0.3", "-o", posture).exit_code == 0
    done = run("render", saved, "-o", out, "--size", 81, "--panels", "pose,parts", "--posture", posture)
    assert done.exit_code == 0
    with av.open(str(out)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 24 and frames[0].shape == (102, 162, 3)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["-o", "clip.avi"], "clip.avi: a clip is written as .gif or .mp4"),
        (["-o", "c.gif", "--panels", "x"], "--panels x: choose from input, parts, skeleton, flow, pose"),
        (["-o", "c.gif", "--panels", ","], "choose from"),
        (["-o", "c.gif", "--view", "left"], "--view left: must be auto or two numbers"),
        (["-o", "c.gif", "--view", "1,100"], "--view 1,100: must be auto or two numbers"),
        (["-o", "c.gif", "--up", "w"], "--up w: must be x, y or z"),
        (["-o", "c.gif", "--size", "5"], "--size 5: must be 64 to 2000 pixels"),
        (["-o", "c.gif", "--posture", "none.json"], "none.json: no such file"),
    ],
)
def test_bad_options_are_one_line(
    saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], what: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("render", saved, *arguments)
    assert done.exit_code == 2 and what in one_line(done)
    assert not list(tmp_path.iterdir())


def test_a_clip_is_replaced_only_when_asked(saved: Path, tmp_path: Path) -> None:
    (tmp_path / "c.gif").write_bytes(b"mine")
    assert "exists" in one_line(run("render", saved, "-o", tmp_path / "c.gif"))
    assert (tmp_path / "c.gif").read_bytes() == b"mine"
