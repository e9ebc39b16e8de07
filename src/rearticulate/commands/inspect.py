"""`info` and `eval`: what is in a file, and how good a result is."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.commands.options import InputOptions
from rearticulate.commands.show import print_json, show_facts, show_metrics, show_result
from rearticulate.io.measure import extent, grid_step, median_spacing, unit_guess
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.io.order import describe_order
from rearticulate.io.sequence import load_sequence
from rearticulate.io.truth import load_truth
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.report.summary import length, result_as_dict


def run_eval(folder: Path, truth_file: Path, report: bool, as_json: bool) -> None:
    """The command `eval`."""
    from rearticulate.evaluation.metrics import canonical_labels, evaluate

    result, truth, sequence = load_result(folder), load_truth(truth_file), load_sequence_of(folder)
    metrics = evaluate(result, truth, sequence)
    if report:
        from rearticulate.report.html import Score, write_report

        score = Score(metrics, canonical_labels(result, truth, sequence))
        write_report(folder, result, sequence, score, title=folder.resolve().name)
    if as_json:
        print_json({m.key: m.value for m in metrics})
    else:
        show_metrics(metrics)


def run_info(source: str, given: InputOptions, as_json: bool) -> None:
    """The command `info`."""
    path = Path(source)
    folder = path.parent if path.name == "model.json" else path
    if os.path.exists(folder / "model.json"):  # False where the name itself is impossible
        _info_of_result(folder, as_json)
    elif path.name.endswith(".truth.npz"):
        _info_of_truth(load_truth(path), as_json)
    else:
        _info_of_sequence(load_sequence(source, **given.keywords()), as_json)


def _info_of_result(folder: Path, as_json: bool) -> None:
    result = load_result(folder)
    if as_json:
        print_json({"kind": "model", **result_as_dict(result)})
    else:
        show_result(result)


def _info_of_truth(truth: GroundTruth, as_json: bool) -> None:
    kinds = None if truth.joint_type is None else list(truth.joint_type)
    facts: dict[str, Any] = {
        "kind": "ground truth",
        "frames": len(truth.labels),
        "parts": len(truth.parent),
        "parent": truth.parent.tolist(),
        "joint_type": kinds,
        "novel_poses": len(truth.novel),
    }
    if as_json:
        print_json(facts)
    else:
        show_facts({name.replace("_", " "): str(value) for name, value in facts.items() if value is not None})


def _info_of_sequence(sequence: PointSequence, as_json: bool) -> None:
    sizes = [len(p) for p in sequence.points]
    box = extent(sequence)
    spacing, step = median_spacing(sequence), grid_step(sequence.points[len(sequence) // 2])
    unit, advice = unit_guess(float(np.linalg.norm(box)))
    if as_json:
        facts = {"frames": len(sequence), "points": sizes, "source_points": sequence.source_points}
        facts |= {"names": sequence.names, "size": box, "spacing": spacing, "step": step, "unit_guess": unit}
        print_json({"kind": "sequence", **facts})
        return
    show_facts(
        {
            "frames": str(len(sequence)),
            "order": describe_order(sequence.names),
            "points a frame": points_a_frame(sequence),
            "size": " × ".join(length(float(x)) for x in box) + ", if in metres",
            "spacing": f"{length(spacing)} to the nearest point (median)",
            "step": "none: coordinates are not rounded" if not step.any() else f"{length(step.max())} of coordinates",
            "unit": f"{unit}{advice}",
        }
    )


def points_a_frame(sequence: PointSequence) -> str:
    """How many points were kept, and how many the source holds where these are more."""
    kept = _range([len(points) for points in sequence.points])
    held = _range(sequence.source_points) if sequence.source_points else kept
    return kept if kept == held else f"{kept}, of {held} in the source"


def _range(counts: Sequence[int]) -> str:
    return str(counts[0]) if len(set(counts)) == 1 else f"{min(counts)} to {max(counts)}"
