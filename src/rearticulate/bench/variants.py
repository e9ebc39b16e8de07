"""Configurations that are compared: the presets, and ablations: each mechanism of the direct solver left out, and those
of the paper for its own method.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

from rearticulate.config import MECHANISMS, PRESETS, FitConfig, Mechanism
from rearticulate.errors import InputError

QUICK = {"chamfer_iterations": 200, "emd_iterations": 300, "final_iterations": 25}
ENERGIES = ("chamfer", "flow", "emd")


def _paper(neural: dict[str, Any] | None = None, **settings: Any) -> FitConfig:
    """The paper's preset with other settings."""
    paper = PRESETS["paper"]
    return replace(paper, neural=replace(paper.neural, **(neural or {})), **settings)


def energies(used: tuple[bool, ...]) -> str:
    """Name of the variant with these of `ENERGIES`: always from the middle frame, without the final fit (Table 3)."""
    return "energy:" + "+".join(name for name, on in zip(ENERGIES, used, strict=True) if on)


# the default without one of its mechanisms
WITHOUT: dict[str, Mechanism] = {f"without {name}": name for name in MECHANISMS}
VARIANTS: dict[str, FitConfig] = {
    **PRESETS,
    **{name: FitConfig(without=(mechanism,)) for name, mechanism in WITHOUT.items()},
    **{
        energies(used): _paper(
            {name: 0.0 for name, on in zip(ENERGIES, used, strict=True) if not on} | {"final_iterations": 0},
            canonical_tries=1,
        )
        for used in product((True, False), repeat=3)
        if any(used)
    },
    "without field": _paper({"field": False}),
    "random start": _paper({"start": "random"}),
    "plain matches": _paper({"refined": False}),
    "without Gumbel": _paper({"gumbel": False}),
    "without canonical choice": _paper(canonical_tries=1),
}


def variant(name: str, quick: bool = False) -> FitConfig:
    """The configuration of a name; quick: with few iterations, from one canonical frame. Raises InputError with the
    names."""
    if name not in VARIANTS:
        raise InputError(f"there is no configuration {name!r}; there are {', '.join(VARIANTS)}")
    config = VARIANTS[name]
    limits = {key: min(value, getattr(config.neural, key)) for key, value in QUICK.items()}
    return replace(config, canonical_tries=1, neural=replace(config.neural, **limits)) if quick else config
