"""A picture of the viewer with a result, its last part dragged: python scripts/viewer_picture.py RESULT PICTURE.png

Needs the extra `dev` and a Chromium.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from rearticulate.commands.viewing import open_viewer

FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]

if __name__ == "__main__":
    result, picture = sys.argv[1:]
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    viewer = open_viewer([Path(result)], "127.0.0.1", 0, "z")
    posed, handle = viewer.models[0], viewer.controls[0].handle
    handle.drag_to(handle.position + 0.12 * posed.size * np.array([0.5, 0.0, 1.0]))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport={"width": 1200, "height": 760})
        page.goto(f"http://127.0.0.1:{viewer.server.get_port()}")
        page.get_by_text("Recording").first.wait_for(timeout=60_000)
        page.wait_for_timeout(8000)
        close = page.locator(".mantine-Notification-closeButton")
        for _ in range(close.count()):
            close.first.click()
        page.wait_for_timeout(1000)
        page.screenshot(path=picture)
        browser.close()
    viewer.server.stop()
