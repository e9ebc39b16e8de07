"""Work side by side gives what a plain loop gives."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

from rearticulate import parallel
from rearticulate.parallel import side_by_side


def spectrum(seed):
    x = np.random.default_rng(seed).normal(size=(60, 60))
    return np.linalg.svd(x @ x)[1]


def refuse(job):
    if job == 2:
        raise ValueError("job 2 cannot be done")
    return job


def where(job):
    return job, os.getpid()


@pytest.mark.parametrize("jobs", [[], [7], [3, 1], [5, 4, 3, 2, 1, 0]])
def test_results_come_in_order_and_equal_those_of_a_loop(jobs):
    found = side_by_side(spectrum, spectrum, jobs)
    assert len(found) == len(jobs)
    for job, value in zip(jobs, found, strict=True):
        np.testing.assert_allclose(value, spectrum(job), rtol=1e-12)


def test_the_same_bits_on_one_core(monkeypatch):
    several = side_by_side(spectrum, spectrum, [1, 2, 3])
    monkeypatch.setattr(parallel.os, "cpu_count", lambda: 1)
    np.testing.assert_array_equal(side_by_side(spectrum, spectrum, [1, 2, 3]), several)


def test_the_first_job_runs_here():
    jobs = list(range(4))
    found = side_by_side(where, where, jobs)
    assert [job for job, _ in found] == jobs
    assert found[0][1] == os.getpid()
    assert side_by_side(where, refuse, [2]) == [(2, os.getpid())]  # one job needs no other process


def slow_where(job):
    time.sleep(0.2 if job == 0 else 2.0)
    return where(job)


def test_whoever_is_free_takes_the_next(monkeypatch):
    monkeypatch.setattr(parallel.os, "cpu_count", lambda: 2)
    found = side_by_side(lambda job: slow_where(job) if job == 0 else where(job), slow_where, [0, 1, 2, 3])
    assert [pid == os.getpid() for _, pid in found] == [True, False, True, True]


def test_an_error_elsewhere_is_raised_here_and_later_work_goes_on():
    with pytest.raises(ValueError, match="job 2"):
        side_by_side(refuse, refuse, [0, 1, 2, 3])
    with pytest.raises(ValueError, match="job 2"):
        side_by_side(refuse, refuse, [2, 0])
    assert side_by_side(refuse, refuse, [0, 1, 3]) == [0, 1, 3]
