"""The benchmark's own parts: cases, worker, tables, gate. The fits are perfect ones made from ground truth."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from oracle import perfect_fit
from rearticulate.bench.cases import ALL, BROKEN, PERTURBATIONS, Case, find_case
from rearticulate.bench.columns import mean_metrics
from rearticulate.bench.flow_page import fits
from rearticulate.bench.gate import is_worse, regressions
from rearticulate.bench.markdown import table
from rearticulate.bench.pages import PAGES, find_page
from rearticulate.bench.results_page import report
from rearticulate.bench.runner import Job, Runner
from rearticulate.bench.variants import variant
from rearticulate.bench.worker import run_case
from rearticulate.commands.benching import choose
from rearticulate.errors import InputError


def perfect_answer(case, folder):
    truth = case.load(folder)[1]
    return run_case(case, folder, 0, lambda sequence, seed: perfect_fit(sequence, truth, 1))


def test_the_cases_are_all_different_and_found_by_name():
    names = [case.name for case in ALL]
    assert len(names) == len(set(names)) == 16 + 8 + 4 * len(PERTURBATIONS)
    assert find_case("nao/noise_1mm") == Case("nao", "noise_1mm")


@pytest.mark.parametrize("change", ["", *PERTURBATIONS])
def test_a_perfect_fit_is_perfect_in_every_case(data_folder, change):
    answer = perfect_answer(Case("refrigerator", change), data_folder)
    metrics = answer["metrics"]
    assert metrics["recon_cm"] == pytest.approx(0, abs=1e-6)
    assert metrics["rand_index_multi_scan"] == 1
    assert metrics["joint_type_share"] == 1
    assert metrics["seen_recon_cm"] == pytest.approx(0, abs=1e-6)
    assert metrics["seen_share"] > 0.9
    assert metrics["joint_axis_median_deg"] == pytest.approx(0, abs=1e-4)
    assert metrics["joint_position_median_percent"] == pytest.approx(0, abs=1e-4)
    assert json.loads(json.dumps(answer)) == answer


@pytest.mark.parametrize("change", BROKEN)
def test_a_perfect_fit_of_a_broken_recording_makes_nothing_up(data_folder, change):
    metrics = perfect_answer(Case("refrigerator", change), data_folder)["metrics"]
    assert (metrics["joints_real"], metrics["joints_made_up"], metrics["joint_type_share"]) == (2, 0, 1)


def test_the_page_of_phantoms_adds_up():
    metrics = {"parts": 4, "parts_true": 2, "joints_real": 1, "joints_real_sure": 1, "joints_made_up": 2}
    metrics["joints_sure_wrong"] = 1
    names = ("microwave/two_states", "cabinet_c1")
    answers = {f"direct/{name}": {**some_answer(), "case": name, "metrics": metrics} for name in names}
    text = PAGES["phantoms"].render({"seed": "0"}, answers)
    assert "| cabinet_c1 | 4 | 2 | 1 | 1 | 2 | 1 | 2.0 |" in text
    assert "| **all** | 8 | 4 | 2 | 2 | 4 | 2 | - |" in text


def some_answer(recon=0.1):
    metrics = {"recon_cm": recon, "rand_index": 0.9, "tree_edit_distance": 1.0, "parts": 3.0, "parts_true": 3.0}
    return {"case": "nao", "seconds": 2.0, "stages": {"track": 1.5}, "peak_mb": None, "metrics": metrics}


def test_the_report_shows_what_there_is():
    answers = {"direct/nao": some_answer(0.1), "direct/nao/noise_1mm": some_answer(0.25)}
    text = report({"seed": "0"}, answers)
    assert "**Without a result:** kinova, ur5" in text
    assert "| nao | noise_1mm | 0.250 | 2.50 |" in text
    assert "| nao | 1.5 | 2.0 |" in text
    assert "mean of all 16" not in text


def test_means_are_over_the_objects_that_have_the_metric():
    assert mean_metrics([{"x": 1.0, "y": 5.0}, {"x": 3.0}]) == {"x": 2.0, "y": 5.0}
    assert mean_metrics([]) == {}


def test_a_table_by_hand():
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n| --- | ---: |\n| 1 | 2 |"


def test_the_gate_names_what_got_worse():
    baseline = {"nao": some_answer(0.10), "solo": some_answer(0.10)}
    now = {"nao": some_answer(0.20), "solo": some_answer(0.11), "a1": some_answer(9.0)}
    assert regressions(baseline, now) == ["nao: recon_cm 0.1 -> 0.2"]
    assert regressions(now, baseline) == []


@pytest.mark.parametrize(
    ("before", "now", "sign", "worse"),
    [(1.0, 1.2, 1, True), (1.0, 0.5, 1, False), (0.9, 0.7, -1, True), (0, 0, 1, False)],
)
def test_worse_by_sign_and_tolerance(before, now, sign, worse):
    assert is_worse(before, now, sign, 0.1, 0.15) == worse


def answers_of(names, variants):
    return {
        f"{variant}/{name}": {**some_answer(), "relaxed": some_answer()["metrics"]}
        for name in names
        for variant in variants
    }


def test_every_page_shows_what_there_is():
    for page in (p for name, p in PAGES.items() if name not in ("flow", "loops")):  # those measure
        text = page.render({"seed": "0"}, {})
        assert text.startswith("# ")
        assert "published" in text.lower() or page in (PAGES["use"], PAGES["phantoms"], PAGES["dynamics"])
    names = ("panda", "nao")
    text = PAGES["energies"].render({}, answers_of(names, {job.variant for job in PAGES["energies"].jobs}))
    assert text.count("0.100 (") == 7
    text = PAGES["designs"].render({}, answers_of(names, {job.variant for job in PAGES["designs"].jobs}))
    assert text.count("0.100 (") == 5
    text = PAGES["robots"].render({}, answers_of(names, ["paper", "direct"]))
    assert "**mean of 2 validation robots** | paper | 0.100" in text


def test_variants_differ_from_the_paper_only_where_they_say():
    paper = variant("paper")
    assert variant("energy:chamfer+flow+emd") == replace(
        paper, canonical_tries=1, neural=replace(paper.neural, final_iterations=0)
    )
    assert variant("energy:emd").neural.chamfer == variant("energy:emd").neural.flow == 0
    quick = variant("paper", quick=True)
    assert quick.neural.chamfer_iterations < paper.neural.chamfer_iterations
    assert quick == replace(paper, canonical_tries=1, neural=quick.neural)
    assert (
        variant("paper-fast", quick=True).neural.chamfer_iterations <= variant("paper-fast").neural.chamfer_iterations
    )
    with pytest.raises(InputError, match=r"no configuration 'x'; there are direct, paper"):
        variant("x")


def test_pages_and_jobs_are_found_by_name():
    jobs = [Job(Case("nao"), "paper"), Job(Case("nao", "noise_1mm")), Job(Case("solo"))]
    assert choose(jobs, frozenset()) == jobs
    assert choose(jobs, frozenset({"nao"})) == jobs[:2]
    assert choose(jobs, frozenset({"direct"})) == jobs[1:]
    assert choose(jobs, frozenset({"nao/noise_1mm"})) == jobs[1:2]
    with pytest.raises(InputError, match="called none"):
        choose(jobs, frozenset({"none"}))
    with pytest.raises(InputError, match="no table 'x'; there are results, robots"):
        find_page("x")


def test_finished_jobs_are_not_run_again(tmp_path):
    runner = Runner(tmp_path)
    job = Job(Case("nao"))
    runner.path(job).parent.mkdir(parents=True)
    runner.path(job).write_text(json.dumps(some_answer()))
    assert runner.run([job]) == {"direct/nao": some_answer()}
    assert Runner(tmp_path, seed=1).path(job) != runner.path(job)
    assert Runner(tmp_path, quick=True).path(Job(Case("nao"), "paper")) != runner.path(Job(Case("nao"), "paper"))


def test_fits_with_and_without_the_network_stand_side_by_side():
    answers = {job.name: some_answer(0.1 if job.variant == "direct" else 0.3) for job in PAGES["flow"].jobs}
    table = fits(answers)[1]
    assert "| **mean** | direct | 0.100" in table
    assert "| nao | without network | 0.300" in table
