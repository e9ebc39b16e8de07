"""`bench`: fits what a page of tables needs and writes it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from rearticulate.bench.cases import data_folder
from rearticulate.bench.gate import Facts, load_facts, regressions, same_machine
from rearticulate.bench.pages import find_page
from rearticulate.bench.runner import Job, Runner
from rearticulate.bench.stamp import stamp
from rearticulate.bench.variants import QUICK, variant
from rearticulate.bounds import Count, Seed, Settings
from rearticulate.commands.outcome import say
from rearticulate.commands.show import print_json
from rearticulate.errors import FitError, InputError
from rearticulate.io.atomic import atomic_file, reserve


@dataclass(frozen=True)
class BenchOptions(Settings):
    """What the command line says about a benchmark. gate: compare with the page as it was, or with `baseline`."""

    only: frozenset[str]
    seed: Seed
    jobs: Count
    fresh: bool
    quick: bool
    gate: bool
    baseline: Path | None
    as_json: bool


def run_bench(name: str, out: Path, options: BenchOptions) -> None:
    """The command `bench`. With `only`, the page is printed but not written."""
    page = find_page(name)
    data_folder()  # says at once where there is none
    wanted = choose(page.jobs, options.only)
    written = out / (f"{name}-quick" if options.quick else name)
    baseline = options.baseline or (written.with_suffix(".json") if options.gate else None)
    before = load_facts(baseline) if baseline else None
    with reserve(out / f"{name}.md"):
        answers = Runner(out / ".cache", options.seed, options.jobs, options.fresh, options.quick).run(wanted)
    configs = {job.variant: variant(job.variant, options.quick) for job in page.jobs}
    facts = {"stamp": stamp(configs, options.seed, options.jobs), "answers": answers}
    if options.quick:
        facts["stamp"]["quick"] = (
            f"one canonical frame, at most {', '.join(f'{value} {key}' for key, value in QUICK.items())}"
        )
    text = page.render(facts["stamp"], answers)
    if options.as_json:
        print_json(facts)
    else:
        print(text)
    if not options.only:
        for suffix, content in ((".md", text), (".json", json.dumps(facts, indent=1) + "\n")):
            with atomic_file(written.with_suffix(suffix)) as partial:
                partial.write_text(content, encoding="utf-8")
    failed = ", ".join(job.name for job in wanted if job.name not in answers)
    problems = [f"without a result: {failed}"] if failed else []
    problems += [f"{problem} in {baseline}" for problem in compare(before, facts)] if before else []
    if problems:
        raise FitError("; ".join(problems))


def choose(jobs: list[Job], only: frozenset[str]) -> list[Job]:
    """The jobs of the named objects, cases or variants; all of them where none is named."""
    names = [{job.name, job.case.name, job.case.object, job.variant} for job in jobs]
    unknown = [name for name in sorted(only) if not any(name in own for own in names)]
    if unknown:
        known = dict.fromkeys(job.case.name for job in jobs)
        raise InputError(f"nothing here is called {', '.join(unknown)}; there are {', '.join(known)}")
    return [job for job, own in zip(jobs, names, strict=True) if not only or own & only]


def compare(before: Facts, now: Facts) -> list[str]:
    """Says which numbers got worse; returns what is wrong with them, in a few words."""
    common = len(before["answers"].keys() & now["answers"].keys())
    if not common:
        return ["none of these fits is"]
    if not same_machine(before, now):
        say("seconds and memory are not compared: another machine, or another number of fits at the same time")
    worse = regressions(before, now)
    for line in worse:
        say(line)
    if not worse:
        say(f"nothing got worse in {common} fits ({len(now['answers']) - common} more are new)")
    return [f"{len(worse)} numbers got worse than"] if worse else []
