"""Where a fit computes: everything on the CPU, or what the paper's solver does by gradient descent on a GPU."""

from __future__ import annotations

from rearticulate.config import FitConfig
from rearticulate.errors import InputError

DEVICES = ("auto", "cpu", "cuda")


def choose_device(name: str, config: FitConfig) -> str:
    """Either "cpu" or "cuda"; auto is the CPU, where the same seed gives the same bits.

    Raises InputError where a fit with these settings has no use for a GPU, and where there is none.
    """
    if name not in DEVICES:
        raise InputError(f"device must be {', '.join(DEVICES[:-1])} or {DEVICES[-1]}, not {name!r}")
    if name != "cuda":
        return "cpu"
    if not config.uses_paper:
        raise InputError(
            "device cuda: the direct solver runs on the CPU; the presets paper and paper-fast can use a GPU"
        )
    import torch

    from rearticulate.methods import paper  # noqa: F401, names the extra that is missing

    if not torch.cuda.is_available():
        raise InputError("device cuda: PyTorch finds no CUDA device here; use auto or cpu")
    return "cuda"
