"""Names that are code somewhere are text everywhere, in a real Chromium."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from browser import needs_chromium
from rearticulate.commands.viewing import open_viewer
from rearticulate.io import save_result
from rearticulate.records import StageTime
from rearticulate.report.escape import in_html, in_label, in_script
from rearticulate.report.html import write_report
from rearticulate.view import words
from toy_result import toy

BEACON = "http://127.0.0.1:9/beacon.png"
NAMES = (
    f"<img src={BEACON} onerror=window.PWN=1> ![i]({BEACON}) {{window.PWN=2}} `x",
    f"<!--<script>window.PWN=3 </script><a href='javascript:window.PWN=4'>k</a> [k]({BEACON})",
    f'"><svg onload=window.PWN=5> ${{window.PWN}} %{{x}} $x$ <image href="{BEACON}"/> \\',
)
FIGURES = {"animation", "parts", "flow", "misfit", "residual", "energy", "time"}


class Watched:
    """A page, what it asked for and what its console said."""

    def __init__(self, chromium: Any) -> None:
        self.asked, self.trouble = [], []
        self.page = chromium.new_page(viewport={"width": 800, "height": 500})
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("console", lambda note: self.trouble.append(note.text) if note.type == "error" else None)
        self.page.on("pageerror", lambda error: self.trouble.append(str(error)))

    def close(self, own: str) -> None:
        """Nothing ran, nothing left but requests to its own address, nothing went wrong."""
        assert self.page.evaluate("window.PWN") is None
        assert [url for url in self.asked if not url.startswith((own, f"blob:{own}", "blob:null", "data:"))] == []
        assert self.trouble == []
        self.page.close()


@needs_chromium
def test_the_report_shows_them_and_all_its_figures(chromium: Any, tmp_path: Path) -> None:
    result, sequence = toy(60, names=NAMES)
    stages = tuple(StageTime(name, 1.0 + k) for k, name in enumerate((*NAMES, "3", "2")))
    path = write_report(tmp_path, replace(result, stages=stages, notes=NAMES), sequence, title=NAMES[1])
    watched = Watched(chromium)
    page = watched.page
    page.goto(path.as_uri())
    page.locator("#time svg").first.wait_for(timeout=60_000)
    page.wait_for_timeout(1000)
    drawn = {figure for figure in FIGURES if page.locator(f"#{figure} svg.main-svg").count()}
    assert drawn == FIGURES
    assert page.title() == f"{NAMES[1]} · rearticulate"
    body = page.inner_text("body")
    assert all(name in re.sub(r"\s+", " ", body) for name in NAMES)
    ticks = page.locator("#time .ytick text").all_text_contents()
    assert set(ticks) == {*NAMES, "3", "2"}
    legend = page.locator("#animation .legendtext").all_text_contents()
    assert set(NAMES) <= set(legend)
    watched.close(path.as_uri())


@needs_chromium
def test_the_viewer_shows_them(chromium: Any, tmp_path: Path) -> None:
    folder = tmp_path / "![i](x) <b>lamp"
    save_result(folder, *toy(60, names=NAMES))
    viewer = open_viewer([folder], "127.0.0.1", 0, "z")
    try:
        watched = Watched(chromium)
        page = watched.page
        page.goto(viewer.address)
        page.get_by_text(folder.name, exact=True).first.wait_for(timeout=60_000)
        for part, name in enumerate(NAMES):
            control = viewer.controls[0]
            control.handle.take(int((control.posed.cloud[1] == part).argmax()))
            control.picked.content = words.described(control.posed.result, part)
            page.get_by_text(name, exact=True).first.wait_for()
        control._tell("saved", lambda: Path(NAMES[0]))
        page.get_by_text(NAMES[0], exact=True).last.wait_for()
        control._tell("saved", lambda: (_ for _ in ()).throw(ValueError(NAMES[1])))
        page.get_by_text(f"failed: {NAMES[1]}", exact=True).wait_for()
        page.wait_for_timeout(1000)
        watched.close(viewer.address.rsplit("/", 2)[0])
    finally:
        viewer.server.stop()


@given(st.text())
def test_escapes_can_be_undone_and_hold_nothing_that_is_code(text: str) -> None:
    for escaped in (in_html(text), in_label(text)):
        assert "<" not in escaped and ">" not in escaped
        assert unescape(escaped.replace("\r", "")) == unescape(in_html(text).replace("\r", ""))
    assert not set(in_html(text)) & set("\"'")
    script = in_script({"name": text})
    assert json.loads(script) == {"name": text}
    assert script.isascii() and not set(script) & set("<>&")


def test_bytes_of_a_file_name_that_are_no_text() -> None:
    assert in_html("a\udcff") == "a?"
