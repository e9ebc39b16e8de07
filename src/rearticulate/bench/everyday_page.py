"""The page of everyday objects and of robots that were not chosen for the paper."""

from __future__ import annotations

from statistics import mean, median

from rearticulate.bench.cases import EVERYDAY, EVERYDAY_ROBOTS, WITH_SLIDES, Case
from rearticulate.bench.columns import COLUMNS, answers_of, mean_metrics, number_cell, parts_cell
from rearticulate.bench.markdown import head, seconds_cell, table
from rearticulate.bench.runner import Answer, Job

Metrics = dict[str, float]

JOBS = [Job(Case(name)) for name in EVERYDAY]
SHARES = ("exact", "tree_and_types", "tree_edit_distance_best_root", "true_edges_share")
ERRORS = ("rand_index", "recon_cm", "reanimate_cm", "axis_z_rms")
_OBJECTS = [name for name in EVERYDAY if name not in EVERYDAY_ROBOTS]
GROUPS = {
    "all": EVERYDAY,
    "objects with hinges only": tuple(name for name in _OBJECTS if name not in WITH_SLIDES),
    "objects with slides": tuple(name for name in _OBJECTS if name in WITH_SLIDES),
    "robots": EVERYDAY_ROBOTS,
}
TEXT = (
    "Everyday objects, 4 frames of 4096 points, the root moves (`_f10`: 10 frames, it rests), and robots, 10 frames. "
    "Exact: the parts, the tree and the types of the joints are the true ones, part by part; tree and types: the tree "
    "with its types has the true shape, whatever its parts are. Both and the edit distance: under the best root where "
    "the root moves. True edges: share of the true joints found with the right type. Axis z: root mean square of the "
    "errors of determined axes over the deviations that the fit tells, 1 where these are honest; in the rows of means "
    "over all joints. *Slide*: has one. Robots are a group of their own, Fetch with its lift among them."
)


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page. answers: those there are, by the names of the jobs."""
    rows = []
    for job in JOBS:
        if found := answers.get(job.name):
            name = job.case.object
            parts, time = parts_cell(found["metrics"]), seconds_cell(found["seconds"])
            rows.append([f"{name} *slide*" if name in WITH_SLIDES else name, *_cells(found["metrics"], parts, time)])
    for label, names in GROUPS.items():
        have = answers_of("direct", names, answers)
        if len(have) == len(names):
            metrics, seconds = [a["metrics"] for a in have], [a["seconds"] for a in have]
            means = _cells(mean_metrics(metrics), "-", seconds_cell(mean(seconds)))
            medians = _cells(_medians(metrics), "-", seconds_cell(median(seconds)))
            rows += [[f"**mean of {label}** ({len(names)})", *means], [f"**median of {label}**", *medians]]
    heads = [COLUMNS[key][0] for key in SHARES], [COLUMNS[key][0] for key in ERRORS]
    columns = ["object", *heads[0], "parts", *heads[1], "s"]
    return "\n\n".join([head("Everyday objects", stamp), TEXT, table(columns, rows)]) + "\n"


def _medians(found: list[Metrics]) -> Metrics:
    """Median of every metric that is no share of objects, over those that have it."""
    keys = [key for key in (*SHARES[2:], *ERRORS) if any(key in one for one in found)]
    return {key: median(one[key] for one in found if key in one) for key in keys}


def _cells(metrics: Metrics, parts: str, time: str) -> list[str]:
    shares, errors = ([number_cell(metrics.get(key), key) for key in keys] for keys in (SHARES, ERRORS))
    return [*shares, parts, *errors, time]
