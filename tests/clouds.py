"""What the tests of readers share: random clouds, and the line that a loader refuses a file with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rearticulate.errors import InputError
from rearticulate.io import load_sequence


def clouds(n_frames: int = 3, n_points: int = 150, seed: int = 0) -> np.ndarray:
    """(F, N, 3) random blobs whose coordinates float32 holds exactly."""
    points = np.random.default_rng(seed).normal(size=(n_frames, n_points, 3))
    return points.astype(np.float32).astype(np.float64)


def refusal(path: Path | str, **options: float) -> str:
    """The line that the loader refuses `path` with."""
    with pytest.raises(InputError) as caught:
        load_sequence(path, **options)
    line = str(caught.value)
    assert "\n" not in line
    assert str(path) in line
    return line
