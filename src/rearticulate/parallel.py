"""Independent pieces of work on all cores, with the same bits as one after the other."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

Job = TypeVar("Job")
Result = TypeVar("Result")

PULSE = 0.2  # seconds


def die_with_parent(parent: int) -> None:
    """From now on this process ends, whatever it does, soon after its parent process (its number) has ended."""
    threading.Thread(target=_outlive, args=(parent,), daemon=True).start()


def _outlive(parent: int) -> None:
    if sys.platform == "win32":  # there a process keeps the number of a parent that is gone
        import _winapi

        synchronize = 0x100000
        _winapi.WaitForSingleObject(_winapi.OpenProcess(synchronize, False, parent), _winapi.INFINITE)
    else:
        while os.getppid() == parent:
            time.sleep(PULSE)
    os._exit(1)


_cores = threading.local()  # that a piece of work may use: those of the machine, or one of several beside it


def _alone(work: Callable[[Any], Any], job: Any, cores: int = 1) -> Any:
    """Run one job with single-threaded linear algebra: sums come out the same wherever it runs."""
    before, _cores.count = getattr(_cores, "count", 1), cores
    try:
        with threadpool_limits(1):
            return work(job)
    finally:
        _cores.count = before


def each(work: Callable[[Job], Result], jobs: Sequence[Job]) -> list[Result]:
    """Results of the jobs, in order, on threads where cores are free: for work that releases the interpreter."""
    count = min(getattr(_cores, "count", 1), len(jobs))
    if count < 2:
        return [work(job) for job in jobs]
    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(work, jobs))


def side_by_side(here: Callable[[Job], Any], elsewhere: Callable[[Job], Any], jobs: Sequence[Job]) -> list[Any]:
    """Results of the jobs, in order. The first runs in this process by `here` (which may report progress); whoever is
    free takes the next, this process by `here`, others by `elsewhere` (picklable)."""
    workers = min(os.cpu_count() or 1, len(jobs)) - 1
    if workers < 1:
        return [_alone(here, job, os.cpu_count() or 1) for job in jobs]
    from loky import get_reusable_executor

    executor = get_reusable_executor(
        max_workers=workers, timeout=60, initializer=die_with_parent, initargs=(os.getpid(),)
    )
    waiting, results = deque(enumerate(jobs)), {}

    def work_off(run: Callable[[Job], Any]) -> None:
        try:
            while True:
                try:
                    i, job = waiting.popleft()
                except IndexError:
                    return  # all are taken
                results[i] = run(job)
        except BaseException:
            waiting.clear()
            raise

    _, first = waiting.popleft()
    with ThreadPoolExecutor(workers) as errands:  # one thread hands out the jobs of one process, and waits for it
        try:
            others = [
                errands.submit(work_off, lambda job: executor.submit(_alone, elsewhere, job).result())
                for _ in range(workers)
            ]
            results[0] = _alone(here, first)
            work_off(lambda job: _alone(here, job))
            for other in others:
                other.result()
        except BaseException:
            waiting.clear()
            executor.shutdown(wait=False, kill_workers=True)
            raise
    return [results[i] for i in range(len(jobs))]
