"""Which numbers of a page got worse than in an earlier one by more than their tolerance."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rearticulate.bench.columns import mean_metrics
from rearticulate.errors import InputError

Facts = dict[str, Any]  # the JSON of a page: its stamp, and answers of worker.run_case by the names of the jobs

# metric: allowed worsening, absolute and as a share of the baseline; the larger counts. Sign: +1 where higher is worse
TOLERANCE = {
    "recon_cm": (+1, 0.02, 0.15),
    "flow_epe_cm": (+1, 0.015, 0.15),
    "flow_acc_5mm": (-1, 0.01, 0.0),
    "flow_acc_5cm": (-1, 0.01, 0.0),
    "rand_index": (-1, 0.01, 0.0),
    "rand_index_multi_scan": (-1, 0.01, 0.0),
    "tree_edit_distance": (+1, 0.0, 0.0),
    "tree_edit_distance_best_root": (+1, 0.0, 0.0),
    "exact": (-1, 0.0, 0.0),
    "true_edges_share": (-1, 0.0, 0.0),
    "reanimate_cm": (+1, 0.05, 0.2),
    "joint_type_share": (-1, 0.0, 0.0),
    "joints_sure_share": (-1, 0.05, 0.0),
    "joints_sure_wrong": (+1, 0.0, 0.0),
    "joint_axis_median_deg": (+1, 0.2, 0.25),
    "joint_position_median_percent": (+1, 0.1, 0.25),
}
POOLED = {"axis_z_rms": (+1, 0.2, 0.15)}  # over all joints of the page
COSTS = {"seconds": (+1, 5.0, 0.5), "peak_mb": (+1, 200.0, 0.5)}  # of an answer, on one machine
SAME = ("machine", "jobs")  # lines of the stamp without which costs do not compare


def load_facts(path: Path) -> Facts:
    """The JSON of an earlier page. Raises InputError where it is none."""
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        if all(isinstance(answer["metrics"], dict) for answer in facts["answers"].values()):
            return facts
        error = "no metrics"
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as found:
        error = found
    raise InputError(f"{path}: not the numbers of an earlier benchmark ({error})")


def same_machine(before: Facts, now: Facts) -> bool:
    """Whether seconds and memory of two pages compare."""
    return all(before.get("stamp", {}).get(line) == now["stamp"].get(line) for line in SAME)


def regressions(before: Facts, now: Facts) -> list[str]:
    """One line a number that got worse, of the answers that both have; seconds and memory on one machine only."""
    old, new = before["answers"], now["answers"]
    lines, common = [], sorted(old.keys() & new.keys())
    costs = COSTS if same_machine(before, now) else {}
    for name in common:
        lines += _worse(name, old[name]["metrics"], new[name]["metrics"], TOLERANCE)
        lines += _worse(name, old[name], new[name], costs)
    pool, pool_now = (mean_metrics(answers[name]["metrics"] for name in common) for answers in (old, new))
    return lines + _worse("all joints", pool, pool_now, POOLED)


def is_worse(before: float, now: float, sign: int, absolute: float, relative: float) -> bool:
    return sign * (now - before) > max(absolute, relative * abs(before)) + 1e-12


def _worse(name: str, before: Facts, now: Facts, limits: dict[str, tuple[int, float, float]]) -> list[str]:
    """Lines of the numbers that both have."""
    have = [key for key in limits if before.get(key) is not None and now.get(key) is not None]
    return [
        f"{name}: {key} {before[key]:.4g} -> {now[key]:.4g}"
        for key in have
        if is_worse(before[key], now[key], *limits[key])
    ]
