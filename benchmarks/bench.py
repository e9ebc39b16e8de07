"""Fit all sequences with ground truth and write results.md and results.json beside this file.

Finished cases are kept in .cache, keyed by code, configuration and seed: a run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from cases import SETS, Case, data_folder
from gate import regressions
from stamp import code_hash, config_hash, stamp
from tables import report

HERE = Path(__file__).resolve().parent


def main(arguments: list[str] | None = None) -> int:
    options = parse(arguments)
    data_folder()  # says at once where there is none
    chosen = choose(SETS[options.set], options.only)
    cache = HERE / ".cache" / f"{code_hash()}-{config_hash()}-{options.seed}"
    cache.mkdir(parents=True, exist_ok=True)
    failures = run_all(chosen, cache, options)
    shown = chosen if options.only else SETS["all"]
    answers = finished(shown, cache)
    page = {"stamp": stamp(options.seed, options.jobs), "cases": answers}
    text = report(page["stamp"], answers, missing=[case.name for case in shown if case.name not in answers])
    print(json.dumps(page, indent=1) if options.json else text)
    if not options.only:
        (HERE / "results.md").write_text(text)
        (HERE / "results.json").write_text(json.dumps(page, indent=1) + "\n")
    worse = compare(options.compare, answers)
    return 1 if failures or worse else 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=list(SETS), default="all")
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="an object or a case (nao/noise_1mm); repeatable"
    )
    parser.add_argument("--jobs", type=int, default=1, help="cases at the same time; they share the cores")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument("--compare", type=Path, metavar="BASELINE.json", help="exit with 1 where a number got worse")
    parser.add_argument("--fresh", action="store_true", help="run finished cases again")
    return parser.parse_args(arguments)


def choose(cases: list[Case], only: list[str]) -> list[Case]:
    """The named cases, all of them where none is named."""
    known = {case.name: case for case in cases}
    unknown = [name for name in only if name not in known]
    if unknown:
        raise SystemExit(f"error: no case is called {', '.join(unknown)}; there are {', '.join(known)}")
    return [known[name] for name in only] or cases


def run_all(cases: list[Case], cache: Path, options: argparse.Namespace) -> list[str]:
    """Run what is not finished yet; returns one line a failure."""
    todo = [case for case in cases if options.fresh or not answer_path(case, cache).exists()]
    with ThreadPoolExecutor(max(1, options.jobs)) as pool:
        failures = list(pool.map(lambda case: run_one(case, cache, options), todo))
    return [failure for failure in failures if failure]


def run_one(case: Case, cache: Path, options: argparse.Namespace) -> str:
    """One case in its own process; returns why it failed, or nothing."""
    threads = str(max(1, (os.cpu_count() or 1) // max(1, options.jobs)))
    limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), threads)
    command = [sys.executable, str(HERE / "worker.py"), case.name, str(options.seed), str(answer_path(case, cache))]
    done = subprocess.run(command, env={**os.environ, **limits}, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
        print(f"{case.name}: failed: {last}", file=sys.stderr, flush=True)
        return last
    print(f"{case.name}: {one_line(json.loads(answer_path(case, cache).read_text()))}", file=sys.stderr, flush=True)
    return ""


def one_line(answer: dict[str, Any]) -> str:
    m = answer["metrics"]
    return (
        f"recon {m['recon_cm']:.3f} cm, flow {m['flow_epe_cm']:.3f} cm, Rand {m['rand_index']:.3f}, "
        f"tree {m['tree_edit_distance']:.0f}, parts {m['parts']:.0f} of {m['parts_true']:.0f}, "
        f"{answer['seconds']:.1f} s"
    )


def answer_path(case: Case, cache: Path) -> Path:
    return cache / f"{case.name.replace('/', '-')}.json"


def finished(cases: list[Case], cache: Path) -> dict[str, Any]:
    paths = {case.name: answer_path(case, cache) for case in cases}
    return {name: json.loads(path.read_text()) for name, path in paths.items() if path.exists()}


def compare(baseline: Path | None, answers: dict[str, Any]) -> bool:
    """Print what got worse than the baseline; whether anything did."""
    if baseline is None:
        return False
    worse = regressions(json.loads(baseline.read_text())["cases"], answers)
    print("\n".join(worse) or "nothing got worse", file=sys.stderr)
    return bool(worse)


if __name__ == "__main__":
    sys.exit(main())
