"""The pages that `rearticulate bench` makes: which jobs they need and how they look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rearticulate.bench import (
    capture_page,
    dynamics_page,
    everyday_page,
    evidence_page,
    flow_page,
    mechanisms_page,
    paper_pages,
    phantoms_page,
    results_page,
    robustness_page,
    stability_page,
    use_page,
)
from rearticulate.bench.runner import Answer, Job
from rearticulate.errors import InputError
from rearticulate.extras import needs


@dataclass(frozen=True)
class Page:
    """A page of tables. render(stamp, answers by the names of the jobs) -> Markdown."""

    jobs: list[Job]
    render: Callable[[dict[str, str], dict[str, Answer]], str]


def _loops(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    with needs("paper"):
        from rearticulate.bench import loops_page
    return loops_page.report(stamp, answers)


PAGES = {
    "results": Page(results_page.JOBS, results_page.report),
    "robustness": Page(robustness_page.JOBS, robustness_page.report),
    "everyday": Page(everyday_page.JOBS, everyday_page.report),
    "evidence": Page([], evidence_page.report),
    "capture": Page(capture_page.JOBS, capture_page.report),
    "stability": Page(stability_page.JOBS, stability_page.report),
    "mechanisms": Page(mechanisms_page.JOBS, mechanisms_page.report),
    "robots": Page(paper_pages.ROBOT_JOBS, paper_pages.robots),
    "energies": Page(paper_pages.ENERGY_JOBS, paper_pages.energy_ablation),
    "designs": Page(paper_pages.DESIGN_JOBS, paper_pages.design_ablation),
    "household": Page(paper_pages.HOUSEHOLD_JOBS, paper_pages.household),
    "time": Page([*paper_pages.ROBOT_JOBS, *paper_pages.HOUSEHOLD_JOBS], paper_pages.run_time),
    "loops": Page([], _loops),
    "flow": Page(flow_page.JOBS, flow_page.report),
    "use": Page(use_page.JOBS, use_page.report),
    "phantoms": Page(phantoms_page.JOBS, phantoms_page.report),
    "dynamics": Page(dynamics_page.JOBS, dynamics_page.report),
}


def find_page(name: str) -> Page:
    """The page of a name. Raises InputError with the names that exist."""
    if name not in PAGES:
        raise InputError(f"there is no table {name!r}; there are {', '.join(PAGES)}")
    return PAGES[name]
