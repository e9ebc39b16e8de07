"""One case in a process of its own, so that its peak memory is its own:
`python -m rearticulate.bench.worker CASE VARIANT full|quick SEED OUTPUT.json [use]`.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rearticulate.bench.cases import Case, data_folder, find_case
from rearticulate.bench.seen import seen_metrics
from rearticulate.bench.variants import variant
from rearticulate.evaluation.metrics import evaluate
from rearticulate.evaluation.relaxed import evaluate_relaxed
from rearticulate.evaluation.structure import root_moves, structure
from rearticulate.io.atomic import atomic_file
from rearticulate.parallel import die_with_parent
from rearticulate.pipeline import fit
from rearticulate.records import FitResult, GroundTruth, PointSequence

Fit = Callable[..., FitResult]


def run_case(case: Case, folder: Path, seed: int, fitter: Fit, used: bool = False) -> dict[str, Any]:
    """Fit and score one case. Everything in the answer is plain JSON."""
    sequence, truth = case.load(folder)
    started = time.perf_counter()
    result = fitter(sequence, seed=seed)
    seconds = time.perf_counter() - started
    return {
        "case": case.name,
        "frames": len(sequence),
        "points": max(len(p) for p in sequence.points),
        "canonical": result.model.canonical,
        "structure": structure(result.model.parent, result.model.joint_type, root_moves(truth)),
        "seconds": seconds,
        "stages": _seconds_by_stage(result),
        "peak_mb": peak_megabytes(),
        "metrics": {
            **{m.key: float(m.value) for m in evaluate(result, truth, sequence)},
            **seen_metrics(result, truth, sequence),
        },
        "relaxed": _relaxed_metrics(result, truth, sequence),
        **({"use": _use_metrics(result, truth, sequence)} if used else {}),
    }


def _use_metrics(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> dict[str, float]:
    from rearticulate.bench.use import use

    return use(result, truth, sequence)


def _relaxed_metrics(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> dict[str, float]:
    if result.relaxed is None:
        return {}
    found = evaluate_relaxed(result.relaxed, truth, sequence, result.model.canonical)
    return {m.key: float(m.value) for m in found}


def _seconds_by_stage(result: FitResult) -> dict[str, float]:
    """Stages that ran several times (once a canonical frame, say) are added up."""
    total: dict[str, float] = {}
    for stage in result.stages:
        total[stage.name] = total.get(stage.name, 0.0) + stage.seconds
    return total


def peak_megabytes() -> float | None:
    """Largest resident memory of this process so far; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


def main(name: str, configuration: str, length: str, seed: str, output: str, use: str = "") -> None:
    die_with_parent(os.getppid())
    config = variant(configuration, quick=length == "quick")
    answer = run_case(find_case(name), data_folder(), int(seed), partial(fit, config=config), use == "use")
    with atomic_file(output) as temporary:
        temporary.write_text(json.dumps(answer))


if __name__ == "__main__":
    main(*sys.argv[1:])
