"""The page of what depth cameras see of an object: some of its sides."""

from __future__ import annotations

from dataclasses import dataclass

from rearticulate.bench.cases import CAPTURE, SETS, Case
from rearticulate.bench.columns import COLUMNS, number_cell, parts_cell
from rearticulate.bench.markdown import head, seconds_cell, table
from rearticulate.bench.runner import Answer, Job
from rearticulate.bench.seen import ENOUGH

FEWER = Case("cabinet_11views", "points_5000")
KEYS = ("seen_recon_cm", "seen_share", "tree_edit_distance", "exact", "joints_sure_wrong")


@dataclass(frozen=True)
class View:
    """What cameras see, and the same recording from all around where there is one."""

    job: Job
    around: Job | None = None


def _view(name: str) -> View:
    """Recordings `NAME_cN` are those of `NAME`, as N cameras see them."""
    whole, _, cameras = name.rpartition("_c")
    around = cameras.isdigit() and whole in (*SETS["roboart"], *SETS["household"])
    return View(Job(Case(name)), Job(Case(whole)) if around else None)


VIEWS = [*(_view(name) for name in CAPTURE), *(View(Job(FEWER, seed=seed)) for seed in (0, 1, 2))]
JOBS = [job for view in VIEWS for job in (view.job, view.around) if job]
TEXT = (
    "`cabinet_11views`: six states from 11 viewpoints, 20,000 points a frame or 5,000; `_c1`, `_c2`: a sequence of the "
    "other pages as one or two cameras see it; others: a depth sensor with noise, fixed (`_fixed1`, `_fixed2`, "
    "`_fixed4`: cameras), in a hand, or fixed after a first frame from all around (`_scan1`). Recon of seen: the error "
    f"over points whose part shows {ENOUGH} points in both frames, and that of the same sequence from all around where "
    "there is one. Exact: the true parts, tree and joint types. Sure, not there: joints called determined that do not "
    "exist."
)


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page. answers: those there are, by the names of the jobs."""
    rows = [_row(view, answers) for view in VIEWS if view.job.name in answers]
    recon, *others = (COLUMNS[key][0] for key in KEYS)
    columns = ["case", recon, "from all around cm", "ratio", others[0], "parts", *others[1:], "s"]
    return "\n\n".join([head("Captured views", stamp), TEXT, table(columns, rows)]) + "\n"


def _row(view: View, answers: dict[str, Answer]) -> list[str]:
    found = answers[view.job.name]
    metrics, around = found["metrics"], _recon_around(view, answers)
    recon, *others = (number_cell(metrics.get(key), key) for key in KEYS)
    ratio = f"{metrics['seen_recon_cm'] / around:.1f}" if around else "-"
    label = view.job.name.removeprefix("direct/")
    beside = [number_cell(around, "seen_recon_cm"), ratio, others[0], parts_cell(metrics)]
    return [label, recon, *beside, *others[1:], seconds_cell(found["seconds"])]


def _recon_around(view: View, answers: dict[str, Answer]) -> float | None:
    found = answers.get(view.around.name) if view.around else None
    return found["metrics"]["seen_recon_cm"] if found else None
