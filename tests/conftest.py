from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from browser import CHROMIUM, FLAGS, FOREIGN
from shapes import check_shapes

check_shapes()

settings.register_profile("quick", max_examples=25, deadline=None, derandomize=True)
settings.load_profile("quick")

SLOW = (  # whole fits, browsers, thousands of files, fresh processes: all others take less than a minute together
    *("atomic", "bench", "bounds", "cli", "deviation", "examples", "export", "export_command", "extras", "fit", "gate"),
    *("hostile", "hostile_names", "incomplete", "localization", "matched_starts", "mechanisms", "paper_energies"),
    *("paper_model", "paper_refine", "paper_relax", "parallel", "posing_commands", "public_names", "retarget", "shape"),
    *("spherical", "synth_creatures", "training", "view"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.stem.removeprefix("test_") in SLOW:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of the sequences with ground truth: $REARTICULATE_DATA, or ../shared/data beside the repository."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("REARTICULATE_DATA") or beside)
    if not folder.is_dir():
        pytest.skip(f"no sequences with ground truth in {folder}: set REARTICULATE_DATA")
    return folder


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """A browser for all tests that need one, in which the foreign name leads to this machine."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        flags = [*FLAGS, f"--host-resolver-rules=MAP {FOREIGN} 127.0.0.1"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield browser
        browser.close()
