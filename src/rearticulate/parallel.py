"""Independent pieces of work on all cores, with the same bits as one after the other."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

Job = TypeVar("Job")


def _alone(work: Callable[[Any], Any], job: Any) -> Any:
    """Run one job with single-threaded linear algebra: sums come out the same wherever it runs."""
    with threadpool_limits(1):
        return work(job)


def side_by_side(here: Callable[[Job], Any], elsewhere: Callable[[Job], Any], jobs: Sequence[Job]) -> list[Any]:
    """Results of the jobs, in order. The first runs in this process by `here` (which may report progress), the others
    by `elsewhere` (picklable) in further processes; the last is taken back if nobody has begun it by then."""
    cores = os.cpu_count() or 1
    if len(jobs) < 2 or cores < 2:
        return [_alone(here, job) for job in jobs]
    from loky import get_reusable_executor

    executor = get_reusable_executor(max_workers=min(cores, len(jobs)) - 1, timeout=60)
    futures = [executor.submit(_alone, elsewhere, job) for job in jobs[1:]]
    try:
        results = [_alone(here, jobs[0])]
        if futures[-1].cancel():
            taken = _alone(here, jobs[-1])
            return results + [f.result() for f in futures[:-1]] + [taken]
        return results + [f.result() for f in futures]
    except BaseException:
        executor.shutdown(wait=False, kill_workers=True)
        raise
