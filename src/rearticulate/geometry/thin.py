"""Fewer points for a picture."""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Int


def thinned(n: int, budget: int, seed: int = 0) -> Int[Array, " k"]:
    """At most `budget` of n rows, spread at random, in order; the same ones every time."""
    if n <= budget:
        return np.arange(n)
    return np.sort(np.random.default_rng(seed).choice(n, budget, replace=False))
