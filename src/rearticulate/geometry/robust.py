"""Robust weights: what does not fit counts less."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def geman_mcclure(squared: Array, sigma: float | Array) -> Array:
    """Weight of a residual with this square under the Geman-McClure kernel."""
    return 1.0 / (1.0 + squared / (sigma * sigma)) ** 2
