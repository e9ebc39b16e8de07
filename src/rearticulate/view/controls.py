"""The controls of one model: recording, joints, handle, parts, files."""

from __future__ import annotations

import io
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import viser
from PIL import Image

from rearticulate.posing.blend import between_frames
from rearticulate.records import Posture
from rearticulate.render.panels import novel_posture
from rearticulate.view import words
from rearticulate.view.drag_handle import DragHandle
from rearticulate.view.posed_model import PosedModel

FEW = 8  # joints whose labels do not hide the object
RATE = 15.0  # steps a second while playing
SPEED = 3.0  # frames a second
BEYOND = 0.25  # what a slider reaches beyond the observed range, a share of it
SHOT = (1080, 1600)  # pixels of a screenshot where the browser does not tell its own


@dataclass(frozen=True)
class Savers:
    """What the buttons do with files, one press at a time. Each gets the model and returns the path it wrote."""

    posture: Callable[[PosedModel], Path]
    export: Callable[[PosedModel], Path]
    screenshot: Callable[[PosedModel, bytes], Path]
    busy: threading.Lock = field(default_factory=threading.Lock)


class Controls:
    """The panel of one model."""

    def __init__(self, server: viser.ViserServer, posed: PosedModel, savers: Savers) -> None:
        self._server, self.posed, self._savers = server, posed, savers
        self._playing, self._seed = False, 0
        self.along: list[Controls] = []  # of other fits of the same recording, which show the same moment
        self.handle = DragHandle(server, posed, self._synchronize)
        gui = server.gui
        gui.add_html(words.title(posed.name, posed.result, posed.sequence))
        with gui.add_folder("Recording"):
            self._add_recording()
        with gui.add_folder("Joints"):
            self.sliders = self._add_sliders()
        with gui.add_folder("Drag"):
            self._add_handle()
        with gui.add_folder("Parts"):
            self._add_parts()
        with gui.add_folder("Files"):
            self._add_files()
        self._synchronize()

    def show(self, posture: Posture) -> None:
        """A posture, also on the sliders and at the handle."""
        self.posed.show(posture)
        self._synchronize()

    def show_moment(self, now: float) -> None:
        """A moment of the recording, in frames: the nearest measured points, the fitted posture between the frames."""
        if round(now) != self.posed.frame:
            self.posed.show_frame(round(now))
            self.time.value = round(now)
        self.show(between_frames(self.posed.result.motion, np.array([now])).posture(0))

    def pick(self, row: int) -> None:
        """A point of the model's cloud was clicked: the handle takes it, its part is described."""
        self.handle.take(row)
        self.picked.content = words.described(self.posed.result, self.handle.part)

    def _synchronize(self) -> None:
        for where, slider in self.sliders.items():
            shown = round(float(self.posed.posture.q[where]) * self._unit(where), 2) + 0.0  # and never -0.0
            slider.value = float(np.clip(shown, slider.min, slider.max))
        self.handle.follow()

    def _unit(self, where: int) -> float:
        """What is shown of 1 rad or 1 m: degrees or centimetres."""
        model = self.posed.model
        return 100.0 if where < model.n_parts and model.joint_type[where] == "prismatic" else 180 / math.pi

    def _add_recording(self) -> None:
        gui, last = self._server.gui, len(self.posed.sequence) - 1
        self.time = gui.add_slider("frame", 0, max(last, 1), 1, self.posed.frame, disabled=last < 1)
        self.play = gui.add_button("Play", disabled=last < 1)
        measured = gui.add_checkbox("measured points", True)
        axes = gui.add_checkbox("joint axes", True)
        labels = gui.add_checkbox("joint labels", self.posed.model.n_parts - 1 <= FEW)
        self.posed.show_labels(labels.value)

        @self.time.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._show_together(float(self.time.value))

        self.play.on_click(lambda event: self._toggle_play())
        measured.on_update(lambda event: self.posed.show_measured(measured.value))
        axes.on_update(lambda event: self.posed.show_axes(axes.value))
        labels.on_update(lambda event: self.posed.show_labels(labels.value))

    def _show_together(self, now: float) -> None:
        for controls in (self, *self.along):
            controls.show_moment(now)

    def _set_playing(self, playing: bool) -> None:
        self._playing, self.play.label = playing, "Pause" if playing else "Play"

    def _toggle_play(self) -> None:
        for controls in self.along:
            controls._set_playing(False)
        self._set_playing(not self._playing)
        if self._playing:
            threading.Thread(target=self._play, daemon=True).start()

    def _play(self) -> None:
        """There and back until it is stopped, the model moving between the frames too."""
        last = len(self.posed.sequence) - 1
        now, step = float(self.time.value), SPEED / RATE
        while self._playing:
            if not 0 <= now + step <= last:
                step = -step
            now = min(max(now + step, 0.0), float(last))
            self._show_together(now)
            time.sleep(1 / RATE)

    def _add_sliders(self) -> dict[int, viser.GuiSliderHandle[float]]:
        """A slider a joint value, by its place in q."""
        model, out = self.posed.model, {}
        for j in range(1, model.n_parts):
            kind = model.joint_type[j]
            if kind == "fixed":
                continue
            low, high = (-model.limits[j, 1], model.limits[j, 1]) if kind == "spherical" else model.limits[j]
            slack = BEYOND * (high - low) + 1e-3
            for letter, where in zip("xyz", model.values(j), strict=False):
                unit = self._unit(where)
                turns, digits = ("°", 1) if unit != 100 else ("cm", 2)
                name = f"{model.names[j]} {letter}" if kind == "spherical" else model.names[j]
                lowest, highest = (round(float(unit * x), digits) for x in (low - slack, high + slack))
                slider = self._server.gui.add_slider(f"{name}, {turns}", lowest, highest, 10.0**-digits, 0.0, hint=kind)
                slider.on_update(self._slid(where, slider))
                out[where] = slider
        return out

    def _slid(self, where: int, slider: viser.GuiSliderHandle[float]) -> Callable[[viser.GuiEvent], None]:
        def update(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            q = self.posed.posture.q.copy()
            q[where] = slider.value / self._unit(where)
            self.posed.show(Posture(q, self.posed.posture.T_world_root))
            self.handle.follow()

        return update

    def _add_handle(self) -> None:
        gui = self._server.gui
        gui.add_html(words.says("Click a point of the object, then drag the arrows."))
        root = gui.add_checkbox("the root may move", False)
        pins = gui.add_button_group(
            "points", ("Pin", "Unpin all"), hint="A pinned point stays while others are dragged."
        )
        postures = gui.add_button_group("posture", ("Rest", "New"), hint="New: within the observed ranges.")

        @root.on_update
        def _(event: viser.GuiEvent) -> None:
            self.handle.root_moves = root.value

        @pins.on_click
        def _(event: viser.GuiEvent) -> None:
            self.handle.pin() if pins.value == "Pin" else self.handle.unpin()

        @postures.on_click
        def _(event: viser.GuiEvent) -> None:
            if postures.value == "Rest":
                self.show(Posture.rest(self.posed.model))
            else:
                self.show(novel_posture(self.posed.model, self._seed))
                self._seed += 1

    def _add_parts(self) -> None:
        gui, model = self._server.gui, self.posed.model
        gui.add_html(words.tree_of(model))
        self.picked = gui.add_html(words.described(self.posed.result, self.handle.part))
        self.shown = []
        for p, name in enumerate(model.names):
            box = gui.add_checkbox(name, True)
            box.on_update(self._toggled(p, box))
            self.shown.append(box)

    def _toggled(self, part: int, box: viser.GuiCheckboxHandle) -> Callable[[viser.GuiEvent], None]:
        return lambda event: self.posed.show_part(part, box.value)

    def _add_files(self) -> None:
        gui = self._server.gui
        save = gui.add_button("Save posture")
        export = gui.add_button("Export")
        shot = gui.add_button("Screenshot")
        self.written = gui.add_html("")

        @save.on_click
        def _(event: viser.GuiEvent) -> None:
            self._tell("saved", lambda: self._savers.posture(self.posed))

        @export.on_click
        def _(event: viser.GuiEvent) -> None:
            export.disabled, self.written.content = True, words.says("exporting ...")
            self._tell("exported", lambda: self._savers.export(self.posed))
            export.disabled = False

        @shot.on_click
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                client = event.client
                self._tell("saved", lambda: self._savers.screenshot(self.posed, screenshot(client)))

    def _tell(self, word: str, write: Callable[[], Path]) -> None:
        if not self._savers.busy.acquire(blocking=False):
            self.written.content = words.says("one file at a time: press again when the last is written")
            return
        try:
            self.written.content = words.written(word, write())
        except Exception as error:  # a viewer stays up
            self.written.content = words.says(f"failed: {error}")
        finally:
            self._savers.busy.release()


def screenshot(client: viser.ClientHandle) -> bytes:
    """What a browser shows, as PNG."""
    height, width = client.camera.image_height or SHOT[0], client.camera.image_width or SHOT[1]
    pixels = client.get_render(height, width, transport_format="png", timeout=30.0)
    file = io.BytesIO()
    if pixels.shape[-1] == 4:
        white = Image.new("RGBA", pixels.shape[1::-1], (255, 255, 255, 255))
        image = Image.alpha_composite(white, Image.fromarray(pixels)).convert("RGB")
    else:
        image = Image.fromarray(pixels)
    image.save(file, "PNG")
    return file.getvalue()
