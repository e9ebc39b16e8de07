"""Robust weights: what does not fit counts less."""

from __future__ import annotations

from rearticulate.arrays import Array, Float


def geman_mcclure(squared: Float[Array, "*#shape"], sigma: float | Float[Array, "*#shape"]) -> Float[Array, "*shape"]:
    """Weight of a residual with this square under the Geman-McClure kernel."""
    return 1.0 / (1.0 + squared / (sigma * sigma)) ** 2
