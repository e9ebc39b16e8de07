"""Runs jobs in processes of their own and keeps their answers.

A finished job is kept under the hash of code, configuration and seed: a run that was stopped goes on where it was.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rearticulate.bench.cases import Case
from rearticulate.bench.stamp import config_hash
from rearticulate.bench.variants import variant
from rearticulate.version import code_hash

Answer = dict[str, Any]  # see worker.run_case


@dataclass(frozen=True)
class Job:
    """One fit: a case under one of `variants.VARIANTS`. use: the model is exported, posed and simulated as well. seed:
    what is added to the seed of the run."""

    case: Case
    variant: str = "direct"
    use: bool = False
    seed: int = 0

    @property
    def name(self) -> str:
        seed = f" seed {self.seed}" if self.seed else ""
        return f"{self.variant}/{self.case.name}{seed}" + (" used" if self.use else "")


@dataclass(frozen=True)
class Runner:
    """cache: folder of finished jobs. jobs: how many at the same time; they share the cores. quick: see `variant`."""

    cache: Path
    seed: int = 0
    jobs: int = 1
    fresh: bool = False
    quick: bool = False
    _running: set[subprocess.Popen] = field(default_factory=set, init=False, repr=False)

    def run(self, wanted: list[Job]) -> dict[str, Answer]:
        """Answers by the names of the jobs; a job that fails says why on stderr and has none."""
        todo = [job for job in wanted if self.fresh or not self.path(job).exists()]
        with ThreadPoolExecutor(max(1, self.jobs)) as pool:
            try:
                list(pool.map(self._run_one, todo))
            except BaseException:
                for process in list(self._running):
                    process.kill()
                raise
        return {job.name: json.loads(self.path(job).read_text()) for job in wanted if self.path(job).exists()}

    def path(self, job: Job) -> Path:
        """Where the answer of a job is kept."""
        key = f"{code_hash()}-{config_hash(variant(job.variant, self.quick))}-{self.seed + job.seed}"
        return self.cache / key / f"{job.case.name.replace('/', '-')}{'-used' if job.use else ''}.json"

    def _run_one(self, job: Job) -> None:
        path = self.path(job)
        path.parent.mkdir(parents=True, exist_ok=True)
        threads = str(max(1, (os.cpu_count() or 1) // max(1, self.jobs)))
        limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), threads)
        module = "rearticulate.bench.worker"
        seed = str(self.seed + job.seed)
        wanted = [job.case.name, job.variant, "quick" if self.quick else "full", seed, str(path)]
        command = [sys.executable, "-m", module, *wanted, *(["use"] if job.use else [])]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen(command, env={**os.environ, **limits}, **pipes) as process:
            self._running.add(process)
            errors = process.communicate()[1]
            self._running.discard(process)
        if process.returncode:
            line = f"failed: {(errors.strip() or f'exit code {process.returncode}').splitlines()[-1]}"
        else:
            line = one_line(json.loads(path.read_text()))
        print(f"{job.name}: {line}", file=sys.stderr, flush=True)


def one_line(answer: Answer) -> str:
    """What a finished job says."""
    m = answer["metrics"]
    return (
        f"recon {m['recon_cm']:.3f} cm, flow {m['flow_epe_cm']:.3f} cm, Rand {m['rand_index']:.3f}, "
        f"tree {m['tree_edit_distance']:.0f}, parts {m['parts']:.0f} of {m['parts_true']:.0f}, "
        f"{answer['seconds']:.1f} s"
    )
