"""The viewer, end to end in a headless Chromium. Pictures of it are left in test-artifacts/."""

from __future__ import annotations

import io
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from browser import needs_chromium
from oracle import perfect_fit
from rearticulate.commands.viewing import open_viewer, savers, viewer_names
from rearticulate.errors import FitError, InputError
from rearticulate.geometry.se3 import transform
from rearticulate.io import load_sequence, load_truth, save_result
from rearticulate.io.atomic import atomic_file, reserve
from rearticulate.io.numbered import write_numbered
from rearticulate.io.posture import load_posture
from rearticulate.records import Posture
from rearticulate.synth import bundled
from rearticulate.view.posed_model import on_ray
from rearticulate.view.viewer import Viewer
from test_cli import one_line, run
from toy_result import toy

ARTIFACTS = Path(__file__).parents[1] / "test-artifacts"
KNOWN = "THREE.Clock"  # a warning of the library that viser draws with


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled arm, as a perfect fit."""
    path = tmp_path_factory.mktemp("results") / "arm"
    sequence = load_sequence(bundled.path("so101"))
    save_result(path, perfect_fit(sequence, load_truth(bundled.truth_path("so101")), 5), sequence)
    return path


@pytest.fixture(scope="module")
def viewer(folder: Path) -> Iterator[Viewer]:
    viewer = open_viewer([folder], "127.0.0.1", 0, "z")
    yield viewer
    viewer.server.stop()


class Page:
    """A page of the viewer, and what its console said."""

    def __init__(self, chromium: Any, viewer: Viewer) -> None:
        self.viewer, self.trouble = viewer, []
        self.page = chromium.new_page(viewport={"width": 1200, "height": 800})
        self.page.on("console", lambda m: self.trouble.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda error: self.trouble.append(str(error)))
        self.page.on("requestfailed", lambda request: self.trouble.append(f"failed: {request.url}"))
        self.page.goto(viewer.address)
        self.page.get_by_text("Recording").first.wait_for(timeout=60_000)
        until(lambda: self.picture().std() > 3, "nothing is drawn")
        close = self.page.locator(".mantine-Notification-closeButton")  # that the drawing is done by software
        for _ in range(close.count()):
            close.first.click()
        self.page.wait_for_timeout(500)

    def picture(self, name: str = "") -> np.ndarray:
        """What is drawn; kept under a name."""
        png = self.page.screenshot(clip={"x": 0, "y": 0, "width": 880, "height": 800})
        if name:
            ARTIFACTS.mkdir(exist_ok=True)
            self.page.screenshot(path=ARTIFACTS / f"{name}.png")
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=float)

    def field(self, label: str) -> Any:
        """The input in the row of a label."""
        row = self.page.get_by_text(label, exact=True).first.locator("xpath=ancestor::*[.//input][1]")
        return row.locator("input").last

    def set(self, label: str, value: float) -> None:
        """Type a number."""
        field = self.field(label)
        field.fill(str(value))
        field.press("Enter")

    def screen(self, point: np.ndarray) -> tuple[float, float]:
        """Where a point of the scene (3,) is on the page, from the camera that the browser reports."""
        (client,) = self.viewer.server.get_clients().values()
        camera = client.camera
        forward = np.asarray(camera.look_at) - camera.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, camera.up_direction)
        right = right / np.linalg.norm(right)
        offset = point - camera.position
        half = np.tan(camera.fov / 2)
        x = offset @ right / (offset @ forward) / half / camera.aspect
        y = offset @ np.cross(right, forward) / (offset @ forward) / half
        canvas = self.page.locator("canvas").first.bounding_box()
        return canvas["x"] + canvas["width"] * (1 + x) / 2, canvas["y"] + canvas["height"] * (1 - y) / 2


@pytest.fixture
def page(chromium: Any, viewer: Viewer) -> Iterator[Page]:
    for control in viewer.controls:
        control.handle.unpin()
        control.show_moment(float(control.posed.model.canonical))
    page = Page(chromium, viewer)
    yield page
    trouble = [text for text in page.trouble if KNOWN not in text]
    page.page.close()
    until(lambda: not viewer.server.get_clients(), "the page is still connected")
    assert not trouble


def until(true: Callable[[], object], otherwise: str, seconds: float = 30.0) -> None:
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, otherwise
        time.sleep(0.05)


@needs_chromium
def test_a_slider_moves_the_cloud(page: Page) -> None:
    posed = page.viewer.models[0]
    before, cloud = page.picture("viewer-rest"), posed.shown_points()[0]
    page.set("part_2, °", 25)
    until(lambda: abs(np.degrees(posed.posture.q[2]) - 25) < 0.1, "the joint did not move")
    np.testing.assert_allclose(np.delete(posed.posture.q, 2), 0.0, atol=1e-12)
    page.page.wait_for_timeout(500)
    after, labels = page.picture("viewer-slider"), posed.shown_points()[1]
    expected = posed.model.forward(posed.posture.q)[labels]
    np.testing.assert_allclose(posed.shown_points()[0], transform(expected, posed.cloud[0]), atol=1e-12)
    assert np.abs(posed.shown_points()[0] - cloud)[labels >= 2].max() > 0.05
    assert (np.abs(after - before).max(axis=-1) > 30).mean() > 0.005
    handle = page.viewer.server.scene.get_handle_by_name(f"/{posed.name}/part_6")
    np.testing.assert_allclose(handle.position, posed.T_world_part[6][:3, 3], atol=1e-6)


@needs_chromium
def test_time_shows_the_measured_frame_and_its_posture(page: Page) -> None:
    posed = page.viewer.models[0]
    page.set("frame", 2)
    until(lambda: posed.frame == 2, "the frame did not change")
    np.testing.assert_allclose(posed.posture.q, posed.result.motion.q[2])
    shown = [f for f in range(10) if page.viewer.server.scene.get_handle_by_name(f"/{posed.name}/frame_{f}").visible]
    assert shown == [2]
    page.page.get_by_role("button", name="Play").click()
    until(lambda: posed.frame >= 4, "it does not play")
    page.page.get_by_role("button", name="Pause").click()
    page.page.wait_for_timeout(400)
    stopped = posed.posture.q.copy()
    page.page.wait_for_timeout(400)
    np.testing.assert_array_equal(posed.posture.q, stopped)
    page.picture("viewer-played")


@needs_chromium
def test_dragging_the_hand_moves_the_joints(page: Page) -> None:
    posed, handle = page.viewer.models[0], page.viewer.controls[0].handle
    before, held = posed.posture.q.copy(), handle.position
    reach = np.array([0.0, 0.0, 0.09 * posed.size])  # on the arrow that points up
    x, y = page.screen(held + reach)
    mouse = page.page.mouse
    mouse.move(x, y)
    page.page.wait_for_timeout(300)
    mouse.down()
    for step in range(1, 11):
        mouse.move(x, y - 9 * step)
        page.page.wait_for_timeout(60)
    page.picture("viewer-dragged")
    mouse.up()
    until(lambda: np.abs(posed.posture.q - before).max() > 0.05, "the joints did not move")
    page.page.wait_for_timeout(500)
    assert handle.position[2] - held[2] > 0.01
    node = page.viewer.server.scene.get_handle_by_name(f"/{posed.name}/handle")
    np.testing.assert_allclose(node.position, handle.position, atol=1e-6)
    np.testing.assert_array_equal(posed.posture.T_world_root, np.eye(4))
    shown = float(page.field("part_2, °").input_value().rstrip("°"))
    assert shown == pytest.approx(np.degrees(posed.posture.q[2]), abs=0.2)


@needs_chromium
def test_a_click_picks_a_part(page: Page) -> None:
    posed, control = page.viewer.models[0], page.viewer.controls[0]
    page.field("measured points")
    points, labels = posed.shown_points()
    middle = points[labels == 3].mean(axis=0)
    own = points[labels == 3]
    target = own[np.linalg.norm(own - middle, axis=1).argmin()]
    page.page.mouse.click(*page.screen(target))
    until(lambda: control.handle.part == 3, f"part {control.handle.part} was picked")
    page.page.get_by_text("part_3", exact=True).first.wait_for()
    assert np.linalg.norm(control.handle.position - target) < 0.1 * posed.size


@needs_chromium
def test_parts_can_be_hidden(page: Page) -> None:
    posed = page.viewer.models[0]
    before = page.picture()
    page.field("part_0").click()
    until(lambda: not posed.shown_parts()[0], "the part is still shown")
    page.page.wait_for_timeout(500)
    assert (np.abs(page.picture("viewer-hidden") - before).max(axis=-1) > 30).mean() > 0.003
    page.field("part_0").click()
    until(lambda: posed.shown_parts()[0], "the part is still hidden")


@needs_chromium
def test_buttons_write_files(page: Page, folder: Path) -> None:
    posed = page.viewer.models[0]
    page.set("part_1, °", -20)
    until(lambda: posed.posture.q[1] < -0.3, "the joint did not move")
    page.page.get_by_role("button", name="Save posture").click()
    until((folder / "postures" / "001.json").exists, "no posture was saved")
    np.testing.assert_allclose(load_posture(folder / "postures" / "001.json", posed.model).q, posed.posture.q)
    page.page.get_by_role("button", name="Screenshot").click()
    until((folder / "screenshots" / "001.png").exists, "no screenshot was saved")
    ARTIFACTS.mkdir(exist_ok=True)
    shutil.copy(folder / "screenshots" / "001.png", ARTIFACTS / "viewer-screenshot.png")
    picture = np.asarray(Image.open(folder / "screenshots" / "001.png"), dtype=float)
    assert picture.shape[0] >= 700 and picture.std() > 3
    page.page.get_by_role("button", name="Export").click()
    until((folder / "export" / "export.json").exists, "nothing was exported", 120)
    assert (folder / "export" / "arm.urdf").exists()
    page.page.get_by_role("button", name="Export").click()
    page.page.get_by_text("holds an earlier export; name another folder or ask for --overwrite").wait_for()


@needs_chromium
def test_two_results_side_by_side(chromium: Any, folder: Path, tmp_path: Path) -> None:
    save_result(tmp_path / "lamp", *toy(200))
    viewer = open_viewer([folder, tmp_path / "lamp"], "127.0.0.1", 0, "z")
    try:
        page = Page(chromium, viewer)
        page.picture("viewer-two")
        page.page.get_by_role("tab", name="lamp").click()
        page.set("arm, °", 10)
        until(lambda: abs(np.degrees(viewer.models[1].posture.q[1]) - 10) < 0.1, "the second object did not move")
        np.testing.assert_allclose(viewer.models[0].posture.q, 0.0, atol=1e-12)
        assert not [text for text in page.trouble if KNOWN not in text]
        boxes = [np.concatenate(a.sequence.points) + a.offset for a in viewer.models]
        right = np.linalg.svd(np.cov(np.array([a.offset for a in viewer.models]).T))[0][:, 0]
        spans = sorted(sorted((float((box @ right).min()), float((box @ right).max()))) for box in boxes)
        assert spans[0][1] < spans[1][0]
        page.page.close()
    finally:
        viewer.server.stop()


@needs_chromium
def test_two_fits_of_one_recording_show_the_same_moment(chromium: Any, folder: Path) -> None:
    viewer = open_viewer([folder, folder], "127.0.0.1", 0, "z")
    try:
        page = Page(chromium, viewer)
        page.set("frame", 8)
        until(lambda: all(posed.frame == 8 for posed in viewer.models), "one of them stayed behind")
        expected = viewer.models[0].result.motion.q[8]
        until(lambda: np.allclose([a.posture.q for a in viewer.models], expected), "another posture is shown")
        first, second = viewer.controls
        page.page.get_by_role("button", name="Play").first.click()
        until(lambda: viewer.models[1].frame != 8, "only one plays")
        assert first.play.label == "Pause" and second.play.label == "Play"
        page.page.get_by_role("button", name="Pause").first.click()
        page.page.close()
    finally:
        viewer.server.stop()


def test_pins_hold_while_others_are_dragged(viewer: Viewer) -> None:
    posed, handle = viewer.models[0], viewer.controls[0].handle
    viewer.controls[0].show(Posture.rest(posed.model))
    points, labels = posed.cloud
    handle.take(int(np.flatnonzero(labels == 3)[0]))
    handle.pin()
    pinned = handle.position
    handle.take(int(np.flatnonzero(labels == 6)[0]))
    target = handle.position + np.array([0.0, 0.02, 0.02])
    before = np.linalg.norm(target - handle.position)
    handle.drag_to(target)
    assert np.linalg.norm(handle.position - target) < 0.7 * before
    now = transform(posed.T_world_part[3], points[labels == 3][0])
    assert np.linalg.norm(now - pinned) < 0.01
    handle.unpin()
    viewer.controls[0].show(Posture.rest(posed.model))


def test_a_ray_meets_the_foremost_point(viewer: Viewer) -> None:
    posed = viewer.models[0]
    points, _ = posed.shown_points()
    eye = points.mean(axis=0) + posed.offset + np.array([0.0, 0.0, 5.0])
    distance, row = on_ray(posed, eye, np.array([0.0, 0.0, -1.0])) or (0.0, -1)
    column = np.linalg.norm((points + posed.offset - eye)[:, :2], axis=1) < 0.012 * posed.size
    assert row == np.flatnonzero(column)[points[column, 2].argmax()]
    assert distance == pytest.approx(5.0 + points.mean(axis=0)[2] - points[row, 2])
    assert on_ray(posed, eye, np.array([0.0, 0.0, 1.0])) is None


def test_two_folders_of_one_name_are_told_apart(tmp_path: Path) -> None:
    assert viewer_names([tmp_path / "a", tmp_path / "b"]) == ["a", "b"]
    assert viewer_names([tmp_path / "a", tmp_path / "x" / "a"]) == ["a 1", "a 2"]


def test_a_port_in_use_and_a_missing_result_are_one_line(viewer: Viewer, folder: Path, tmp_path: Path) -> None:
    taken = run("view", folder, "--port", viewer.server.get_port())
    assert taken.exit_code == 1 and "cannot listen there" in one_line(taken)
    assert "no result here" in one_line(run("view", tmp_path / "nothing"))


def test_an_export_is_replaced_only_where_it_may_be(
    folder: Path, viewer: Viewer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed, made = viewer.models[0], []
    monkeypatch.setattr("rearticulate.commands.viewing.save_robot", lambda out, *_, **__: made.append(out))
    (tmp_path / "export").mkdir()
    (tmp_path / "export" / "export.json").touch()
    with pytest.raises(InputError, match="--overwrite"):
        savers({posed.name: tmp_path}, "z", overwrite=False).export(posed)
    assert savers({posed.name: tmp_path}, "z", overwrite=True).export(posed) == tmp_path / "export"
    (tmp_path / "export" / "export.json").rename(tmp_path / "export" / "notes.json")
    with pytest.raises(InputError, match="not an earlier export"):
        savers({posed.name: tmp_path}, "z", overwrite=True).export(posed)
    assert made == [tmp_path / "export"]


def test_one_press_at_a_time(viewer: Viewer) -> None:
    control, pressed, go = viewer.controls[0], [], threading.Event()

    def slow() -> Path:
        pressed.append(1)
        go.wait()
        return Path("a")

    first = threading.Thread(target=control._tell, args=("saved", slow))
    first.start()
    until(lambda: pressed, "the first press did nothing")
    control._tell("saved", lambda: pressed.append(2) or Path("b"))
    assert pressed == [1] and "one file at a time" in control.written.content
    go.set()
    first.join()
    assert "saved: <code>a</code>" in control.written.content
    control._tell("saved", lambda: Path("c"))
    assert "saved: <code>c</code>" in control.written.content


def test_fifty_at_once_are_fifty_whole_files(viewer: Viewer, tmp_path: Path) -> None:
    posed = viewer.models[0]
    save = savers({posed.name: tmp_path}, "z", overwrite=False)
    for write, suffix in ((save.posture, "json"), (lambda posed: save.screenshot(posed, b"png"), "png")):
        with ThreadPoolExecutor(50) as pool:
            paths = list(pool.map(write, [posed] * 50))
        assert sorted(path.name for path in paths) == [f"{k:03d}.{suffix}" for k in range(1, 51)]
        assert sorted(paths) == sorted(paths[0].parent.iterdir())
    for path in (tmp_path / "postures").iterdir():
        np.testing.assert_array_equal(load_posture(path, posed.model).q, posed.posture.q)
    assert {path.read_bytes() for path in (tmp_path / "screenshots").iterdir()} == {b"png"}


def test_a_number_that_another_run_is_writing_is_not_taken(tmp_path: Path) -> None:
    def write(path: Path) -> None:
        path.write_text("mine")

    with ThreadPoolExecutor(1) as other, reserve(tmp_path / "001.json"):
        pressed = other.submit(write_numbered, tmp_path, ".json", write)
        assert "in use by another run" in str(pressed.exception())
    assert not list(tmp_path.iterdir())
    assert write_numbered(tmp_path, ".json", write).read_text() == "mine"


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    def full(path: Path) -> None:
        with atomic_file(path) as partial:
            partial.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(FitError, match=r"cannot be written \(No space left on device\)"):
        write_numbered(tmp_path / "postures", ".json", full)
    assert not list(tmp_path.iterdir())
