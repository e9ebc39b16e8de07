"""The columns of the tables, and what stands in them."""

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt
from statistics import mean

from rearticulate.bench.runner import Answer

COLUMNS = {  # metric: head, decimals
    "recon_cm": ("recon cm", 3),
    "flow_epe_cm": ("flow EPE cm", 3),
    "flow_acc_5mm": ("acc 5 mm", 3),
    "flow_acc_10mm": ("acc 10 mm", 3),
    "flow_acc_5cm": ("acc 5 cm", 3),
    "flow_acc_10cm": ("acc 10 cm", 3),
    "rand_index": ("Rand", 3),
    "rand_index_multi_scan": ("Rand multi", 3),
    "rand_index_per_scan": ("Rand per scan", 3),
    "tree_edit_distance": ("tree edit", 2),
    "exact": ("exact", 2),
    "tree_and_types": ("tree and types", 2),
    "tree_edit_distance_best_root": ("tree edit, best root", 2),
    "true_edges_share": ("true edges", 2),
    "reanimate_cm": ("reanimate cm", 2),
    "joint_type_share": ("joint types", 2),
    "joints_sure_share": ("sure", 2),
    "joints_sure_wrong": ("sure, not there", 2),
    "joint_axis_median_deg": ("axis deg", 2),
    "axis_z_rms": ("axis z", 2),
    "joint_position_median_percent": ("axis position %", 2),
    "seen_share": ("seen", 2),
    "seen_recon_cm": ("recon of seen cm", 3),
}


def number_cell(value: float | None, key: str) -> str:
    """A number in the column of a metric."""
    return "-" if value is None else f"{value:.{COLUMNS[key][1]}f}"


def mean_metrics(found: Iterable[dict[str, float]]) -> dict[str, float]:
    """Mean of every metric over those that have it; of the axes' z-scores the root mean square over all joints."""
    every = list(found)
    keys = dict.fromkeys(key for one in every for key in one)
    means = {key: mean(one[key] for one in every if key in one) for key in keys}
    if "axis_z_count" in means:
        means["axis_z_rms"] = sqrt(means["axis_z_squared_sum"] / means["axis_z_count"])
    return means


def parts_cell(metrics: dict[str, float]) -> str:
    """Parts found and true ones."""
    return f"{metrics['parts']:.0f} of {metrics['parts_true']:.0f}"


def answers_of(variant: str, cases: Iterable[str], answers: dict[str, Answer]) -> list[Answer]:
    """The answers there are of one variant."""
    return [answers[key] for case in cases if (key := f"{variant}/{case}") in answers]
