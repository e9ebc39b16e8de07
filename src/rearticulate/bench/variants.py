"""Configurations that are compared: the presets, and the paper's ablations of its own method."""

from __future__ import annotations

from rearticulate.config import PRESETS, FitConfig
from rearticulate.errors import InputError

VARIANTS: dict[str, FitConfig] = dict(PRESETS)


def variant(name: str) -> FitConfig:
    """The configuration of a name. Raises InputError with the names that exist."""
    if name not in VARIANTS:
        raise InputError(f"there is no configuration {name!r}; there are {', '.join(VARIANTS)}")
    return VARIANTS[name]
