"""4D point clouds of any articulated object become rearticulable kinematic models.

    sequence = rearticulate.load_sequence("scans/")
    result = rearticulate.fit(sequence)
    moved = result.model.pose(result.motion.q[0])

The public names are loaded when they are first used, so that `import rearticulate` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rearticulate.config import FitConfig
    from rearticulate.errors import FitError, InputError, InputWarning
    from rearticulate.evaluation.metrics import evaluate
    from rearticulate.export.write import save_robot
    from rearticulate.io import (
        load_model,
        load_result,
        load_scans,
        load_sequence,
        load_sequence_of,
        load_truth,
        save_result,
    )
    from rearticulate.localization.localize import track
    from rearticulate.pipeline import fit
    from rearticulate.records import FitResult, KinematicModel, PointSequence
    from rearticulate.retargeting.retarget import retarget
    from rearticulate.synth.simulate import simulate

_HOME = {
    "FitConfig": "config",
    "FitError": "errors",
    "FitResult": "records",
    "InputError": "errors",
    "InputWarning": "errors",
    "KinematicModel": "records",
    "PointSequence": "records",
    "evaluate": "evaluation.metrics",
    "fit": "pipeline",
    "load_model": "io",
    "load_result": "io",
    "load_sequence": "io",
    "load_sequence_of": "io",
    "load_truth": "io",
    "retarget": "retargeting.retarget",
    "load_scans": "io",
    "save_result": "io",
    "save_robot": "export.write",
    "track": "localization.localize",
    "simulate": "synth.simulate",
}

__all__ = [  # noqa: RUF022  (in the order of use)
    "load_sequence",
    "fit",
    "save_result",
    "load_result",
    "load_sequence_of",
    "load_model",
    "retarget",
    "load_scans",
    "track",
    "save_robot",
    "load_truth",
    "evaluate",
    "simulate",
    "FitConfig",
    "FitResult",
    "KinematicModel",
    "PointSequence",
    "FitError",
    "InputError",
    "InputWarning",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'rearticulate' has no attribute {name!r}")
    home = import_module(f"rearticulate.{_HOME[name]}")
    value = getattr(home, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
