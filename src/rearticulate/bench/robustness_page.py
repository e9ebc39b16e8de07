"""The page of perturbed recordings: fewer points and frames, noise, holes, one side."""

from __future__ import annotations

from rearticulate.bench.cases import PERTURBATIONS, ROBUSTNESS, Case
from rearticulate.bench.columns import COLUMNS
from rearticulate.bench.markdown import head, table
from rearticulate.bench.results_page import object_row
from rearticulate.bench.runner import Answer, Job
from rearticulate.bench.seen import ENOUGH

JOBS = [Job(Case(name, change)) for name in ROBUSTNESS for change in ("", *PERTURBATIONS)]
TEXT = (
    "Each perturbation beside the clean run of the same object. Seen: share of the canonical points, over all frames, "
    f"whose part shows {ENOUGH} points in both frames; what a frame does not show of a part cannot be known there."
)


def report(stamp: dict[str, str], by_job: dict[str, Answer]) -> str:
    """The whole page. by_job: the answers there are, by the names of the jobs."""
    answers = {name.removeprefix("direct/"): answer for name, answer in by_job.items()}
    return "\n\n".join([head("Robustness", stamp), TEXT, rows_of(answers)]) + "\n"


def rows_of(answers: dict[str, Answer]) -> str:
    """The table. answers: by the names of the cases."""
    keys = ["recon_cm", "flow_epe_cm", "rand_index", "tree_edit_distance", "reanimate_cm", "joint_type_share"]
    keys += ["seen_share", "seen_recon_cm"]
    rows = []
    for name in ROBUSTNESS:
        clean = answers.get(name, {}).get("metrics", {}).get("recon_cm")
        for change in ("", *PERTURBATIONS):
            answer = answers.get(f"{name}/{change}" if change else name)
            if answer:
                ratio = answer["metrics"]["recon_cm"] / clean if clean else None
                row = object_row(change or "clean", answer, keys)
                rows.append([name, *row[:2], "-" if ratio is None else f"{ratio:.2f}", *row[2:]])
    heads = [COLUMNS[key][0] for key in keys]
    return table(["object", "change", heads[0], "ratio to clean", *heads[1:], "parts", "true", "s", "MB"], rows)
