"""Which numbers got worse than a baseline by more than their tolerance."""

from __future__ import annotations

from typing import Any

# metric: allowed worsening, absolute and as a share of the baseline; the larger counts. Sign: +1 where higher is worse
TOLERANCE = {
    "recon_cm": (+1, 0.02, 0.15),
    "flow_epe_cm": (+1, 0.015, 0.15),
    "flow_acc_5mm": (-1, 0.01, 0.0),
    "flow_acc_5cm": (-1, 0.01, 0.0),
    "rand_index": (-1, 0.01, 0.0),
    "rand_index_multi_scan": (-1, 0.01, 0.0),
    "tree_edit_distance": (+1, 0.0, 0.0),
    "reanimate_cm": (+1, 0.05, 0.2),
    "joint_type_share": (-1, 0.0, 0.0),
    "joints_sure_share": (-1, 0.05, 0.0),
    "joints_sure_wrong": (+1, 0.0, 0.0),
    "joint_axis_median_deg": (+1, 0.2, 0.25),
    "joint_position_median_percent": (+1, 0.1, 0.25),
}


def regressions(baseline: dict[str, Any], answers: dict[str, Any]) -> list[str]:
    """One line a number that got worse. Both arguments: answers of worker.run_case by case name."""
    lines = []
    for case in sorted(baseline.keys() & answers.keys()):
        before, now = baseline[case]["metrics"], answers[case]["metrics"]
        lines += [
            f"{case}: {key} {before[key]:.4g} -> {now[key]:.4g}"
            for key, limits in TOLERANCE.items()
            if key in before and key in now and is_worse(before[key], now[key], *limits)
        ]
    return lines


def is_worse(before: float, now: float, sign: int, absolute: float, relative: float) -> bool:
    return sign * (now - before) > max(absolute, relative * abs(before)) + 1e-12
