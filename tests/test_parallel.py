"""Work side by side gives what a plain loop gives."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

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


ENDLESS = """
import os, sys, time
from pathlib import Path
from rearticulate.parallel import side_by_side
from rearticulate import parallel

def beat(folder):
    for _ in range(600):
        (Path(folder) / str(os.getpid())).write_text(str(time.time()))
        time.sleep(0.05)

if __name__ == "__main__":
    parallel.os.cpu_count = lambda: 2
    side_by_side(beat, beat, [sys.argv[1]] * 2)
"""


def wait_until(true, seconds=30.0):
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    assert true()


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script, beats = tmp_path / "endless.py", tmp_path / "beats"
    script.write_text(ENDLESS)
    beats.mkdir()
    with subprocess.Popen([sys.executable, str(script), str(beats)], stderr=subprocess.DEVNULL) as parent:
        wait_until(lambda: len(os.listdir(beats)) == 2)
        parent.kill()
    last = lambda: {path.name: path.read_text() for path in beats.iterdir()}  # noqa: E731
    time.sleep(1.0)
    before = last()
    time.sleep(0.5)
    assert last() == before


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGTERM")
def test_being_asked_to_end_is_what_ctrl_c_is(tmp_path):
    script = tmp_path / "command.py"
    script.write_text(
        "import sys, time\nfrom rearticulate import cli\nfrom rearticulate.io.atomic import reserve\n"
        "@cli.app.command()\n@cli.reported\ndef endless():\n    with reserve('out'):\n"
        "        print('begun', flush=True)\n        time.sleep(60)\n"
        "sys.argv = ['rearticulate', 'endless']\ncli.main()\n"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, str(script)], cwd=tmp_path, **pipes) as command:
        assert command.stdout.readline() == "begun\n"
        command.send_signal(signal.SIGTERM)
        told = command.communicate(timeout=30)[1]
    assert (command.returncode, told) == (130, "interrupted\n")
    assert [path.name for path in Path(tmp_path).iterdir()] == ["command.py"]
