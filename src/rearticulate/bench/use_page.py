"""The page of what fitted models are worth to their users."""

from __future__ import annotations

from rearticulate.bench.cases import HOUSEHOLD, ROBOTS, Case
from rearticulate.bench.columns import mean_metrics
from rearticulate.bench.markdown import head, table
from rearticulate.bench.runner import Answer, Job

JOBS = [Job(Case(name), use=True) for name in (*ROBOTS, *HOUSEHOLD)]
COLUMNS = {  # measure: head, format
    "export_s": ("export s", ".1f"),
    "not_closed": ("surfaces not closed", ".0f"),
    "urdf_errors": ("URDF errors", ".0f"),
    "usd_errors": ("USD errors", ".0f"),
    "glb_missing": ("GLB parts missing", ".0f"),
    "glb_errors": ("GLB errors", ".0f"),
    "kinematics_m": ("kinematics m", ".0e"),
    "bad_steps": ("bad steps", ".0f"),
    "measured_to_export_mm": ("input to export mm", ".2f"),
    "export_to_measured_mm": ("export to input mm", ".2f"),
    "spacing_mm": ("spacing mm", ".2f"),
    "retarget_ms": ("15 clicks ms", ".0f"),
    "retarget_miss_mm": ("miss mm", ".3f"),
    "track_cm": ("new scan cm", ".3f"),
    "possible_cm": ("at best cm", ".3f"),
    "track_s": ("a scan s", ".1f"),
    "render_s": ("clip s", ".1f"),
}
TEXT = (
    "Every object fitted by the default preset, then used. Export: all formats. URDF: errors of yourdfpy; it loads in "
    "MuJoCo too, or there is no row. USD: errors of all validators of usd-core. GLB: parts that trimesh does not "
    "find, errors and warnings of the Khronos validator. Kinematics: largest deviation of a body from ours in MuJoCo, "
    "URDF and MJCF, at 100 random postures. Bad steps: warnings and numbers that are not finite in 2,000 steps under "
    "gravity and random controls. Input to export and back: the recorded joint values played in MuJoCo, mean distance "
    "between the measured points and points on the exported surfaces; spacing: between a measured point and the next "
    "one, which two samples of one surface differ by. 15 clicks: one solution from the rest posture. New scan: points "
    "of a frame moved to three true postures that were never recorded; mean error of the model's points under the "
    "posture found; at best: under the posture that true correspondences lead to."
)


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page."""
    rows, found = [], []
    for job in JOBS:
        measured = answers.get(job.name, {}).get("use", {})
        found += [measured] if measured else []
        rows.append([job.case.name, *_cells(measured)])
    rows.append(["**mean**", *_cells(mean_metrics(found) if len(found) == len(JOBS) else {})])
    return (
        "\n\n".join([head("Use", stamp), TEXT, table(["object", *(name for name, _ in COLUMNS.values())], rows)]) + "\n"
    )


def _cells(measured: dict[str, float]) -> list[str]:
    return [format(measured[key], how) if key in measured else "-" for key, (_, how) in COLUMNS.items()]
