"""The methods by the names they have in `FitConfig`. Each is loaded when it is asked for: one needs PyTorch."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rearticulate.methods.problem import Articulate, Relax

RELAX = {"direct": "direct.relax_direct", "neural": "paper.method.relax_paper"}
ARTICULATE = {"direct": "direct.articulate_direct", "paper": "paper.method.articulate_paper"}


def relax_by(name: str) -> Relax:
    """What makes the first half of a fit, `FitConfig.relax`."""
    return _load(RELAX[name])


def articulate_by(name: str) -> Articulate:
    """What makes the second half of a fit, `FitConfig.articulate`."""
    return _load(ARTICULATE[name])


def _load(path: str) -> Any:
    module, _, function = path.rpartition(".")
    return getattr(import_module(f"{__package__}.{module}"), function)
