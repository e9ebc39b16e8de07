"""The pages that `rearticulate bench` makes: which jobs they need and how they look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rearticulate.bench import results_page
from rearticulate.bench.runner import Answer, Job
from rearticulate.errors import InputError


@dataclass(frozen=True)
class Page:
    """A page of tables. render(stamp, answers by the names of the jobs) -> Markdown."""

    jobs: list[Job]
    render: Callable[[dict[str, str], dict[str, Answer]], str]


PAGES = {
    "results": Page(results_page.JOBS, results_page.report),
}


def find_page(name: str) -> Page:
    """The page of a name. Raises InputError with the names that exist."""
    if name not in PAGES:
        raise InputError(f"there is no table {name!r}; there are {', '.join(PAGES)}")
    return PAGES[name]
