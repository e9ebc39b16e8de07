"""The page of joints that do not exist, in situations that break the assumptions of the fit."""

from __future__ import annotations

from rearticulate.bench.cases import BROKEN, CAPTURED, Case
from rearticulate.bench.markdown import head, seconds_cell, table
from rearticulate.bench.runner import Answer, Job

OBJECTS = ("microwave", "refrigerator", "dishwasher", "solo")
CASES = [*(Case(name, change) for change in BROKEN for name in OBJECTS), *(Case(name) for name in CAPTURED)]
JOBS = [Job(case) for case in CASES]
COUNTS = ("parts", "parts_true", "joints_real", "joints_real_sure", "joints_made_up", "joints_sure_wrong")


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page. answers: those there are, by the names of the jobs."""
    found = [answers[job.name] for job in JOBS if job.name in answers]
    rows = [[a["case"], *(f"{a['metrics'][key]:.0f}" for key in COUNTS), seconds_cell(a["seconds"])] for a in found]
    if found:
        rows.append(["**all**", *(f"{sum(a['metrics'][key] for a in found):.0f}" for key in COUNTS), "-"])
    sections = [
        head("Joints that do not exist", stamp),
        "Two states only; every state at a scale of its own (1.004, 0.990, 0.992, 0.951); what one, two or four depth "
        "cameras see. *Real*: joints that stand for a true one or link pieces of its two parts; *made up*: "
        "all others. *Determined*: how many of them are called so.",
        table(["case", "parts", "true", "real", "determined", "made up", "determined", "s"], rows),
    ]
    return "\n\n".join(sections) + "\n"
