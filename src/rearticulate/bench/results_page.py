"""The page of one preset: every object, seconds by stage."""

from __future__ import annotations

from statistics import mean

from rearticulate.bench.cases import HOUSEHOLD, PAPER_TEST, ROBOTS, Case
from rearticulate.bench.columns import COLUMNS, mean_metrics, number_cell
from rearticulate.bench.markdown import head, seconds_cell, table
from rearticulate.bench.published import TEST_ROBOTS
from rearticulate.bench.runner import Answer, Job

ELSEWHERE = {"seen_share", "seen_recon_cm", "tree_and_types", "tree_edit_distance_best_root", "true_edges_share"}
NOT_FOR_ROBOTS = {"flow_acc_5cm", "flow_acc_10cm"} | ELSEWHERE
NOT_FOR_HOUSEHOLD = {"flow_acc_5mm", "flow_acc_10mm"} | ELSEWHERE
PRESET = "direct"
PLAIN = [Case(name) for name in (*ROBOTS, *HOUSEHOLD)]
JOBS = [Job(case, PRESET) for case in PLAIN]
TEXT = (
    "Robots: 10 frames of 4096 points; household objects: 4 frames of 4096 points, the root moves. One default "
    "configuration for all. Exact: share of the objects with the true parts, tree and joint types (under the best root "
    "where the root moves). Joint columns: share of the true joints found with the right type; *sure*: those that the "
    "fit calls determined as well, and how many joints it calls so that do not exist; median error of the axes that it "
    "calls determined, position in percent of the object's diagonal; axis z: root mean square of their errors over the "
    "deviations that the fit tells, 1 where these are honest; in the rows of means over all joints."
)


def report(stamp: dict[str, str], by_job: dict[str, Answer]) -> str:
    """The whole page. by_job: the answers there are, by the names of the jobs."""
    answers = {name.removeprefix(f"{PRESET}/"): answer for name, answer in by_job.items()}
    sections = [
        head("Benchmark", stamp),
        TEXT,
        "## Robots",
        robots(answers),
        "## Household objects",
        household(answers),
        "## Seconds by stage",
        seconds(answers),
    ]
    absent = ", ".join(job.case.name for job in JOBS if job.name not in by_job)
    if absent:
        sections.insert(1, f"**Without a result:** {absent}.")
    return "\n\n".join(sections) + "\n"


def robots(answers: dict[str, Answer]) -> str:
    keys = [key for key in COLUMNS if key not in NOT_FOR_ROBOTS]
    rows = [object_row(name, answers[name], keys) for name in ROBOTS if name in answers]
    rows += _mean_row("mean of the paper's 10 test robots", PAPER_TEST, answers, keys)
    published = [number_cell(TEST_ROBOTS.get(key), key) for key in keys]
    rows.append(["published, the paper's sequences", *published, *4 * ["-"]])
    rows += _mean_row("mean of all 16 robots", ROBOTS, answers, keys)
    return table(["object", *(COLUMNS[key][0] for key in keys), "parts", "true", "s", "MB"], rows)


def household(answers: dict[str, Answer]) -> str:
    keys = [key for key in COLUMNS if key not in NOT_FOR_HOUSEHOLD]
    rows = [object_row(name, answers[name], keys) for name in HOUSEHOLD if name in answers]
    rows += _mean_row("mean of all 8", HOUSEHOLD, answers, keys)
    return table(["object", *(COLUMNS[key][0] for key in keys), "parts", "true", "s", "MB"], rows)


def seconds(answers: dict[str, Answer]) -> str:
    """Seconds of each stage, objects as they are."""
    plain = {name: answers[name] for name in (*ROBOTS, *HOUSEHOLD) if name in answers}
    stages = list(dict.fromkeys(stage for answer in plain.values() for stage in answer["stages"]))
    rows = [
        [name, *(seconds_cell(answer["stages"].get(stage)) for stage in stages), seconds_cell(answer["seconds"])]
        for name, answer in plain.items()
    ]
    return table(["object", *stages, "whole fit"], rows)


def _mean_row(label: str, names: tuple[str, ...], answers: dict[str, Answer], keys: list[str]) -> list[list[str]]:
    """One row, or none where an object is missing."""
    if not all(name in answers for name in names):
        return []
    found = mean_metrics(answers[name]["metrics"] for name in names)
    cells = [number_cell(found.get(key), key) for key in keys]
    ends = [f"{found['parts']:.1f}", f"{found['parts_true']:.1f}"]
    time = seconds_cell(mean(answers[name]["seconds"] for name in names))
    return [[f"**{label}**", *cells, *ends, time, "-"]]


def object_row(label: str, answer: Answer, keys: list[str]) -> list[str]:
    metrics = answer["metrics"]
    cells = [number_cell(metrics.get(key), key) for key in keys]
    parts = [f"{metrics['parts']:.0f}", f"{metrics['parts_true']:.0f}"]
    memory = "-" if answer["peak_mb"] is None else f"{answer['peak_mb']:.0f}"
    return [label, *cells, *parts, seconds_cell(answer["seconds"]), memory]
