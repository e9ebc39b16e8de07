from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("quick", max_examples=25, deadline=None, derandomize=True)
settings.load_profile("quick")


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of the sequences with ground truth: $REARTICULATE_DATA, or ../shared/data beside the repository."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("REARTICULATE_DATA") or beside)
    if not folder.is_dir():
        pytest.skip(f"no sequences with ground truth in {folder}: set REARTICULATE_DATA")
    return folder
