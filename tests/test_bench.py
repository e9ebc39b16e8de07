"""The benchmark's own parts: cases, worker, tables, gate. The fits are perfect ones made from ground truth."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from oracle import perfect_fit
from rearticulate.bench import capture_page, everyday_page, mechanisms_page, robustness_page, stability_page
from rearticulate.bench.cases import (
    BROKEN,
    BUNDLED,
    CAPTURE,
    CAPTURED,
    EVERYDAY,
    PERTURBATIONS,
    RETOLD,
    SETS,
    WITH_SLIDES,
    Case,
    find_case,
)
from rearticulate.bench.columns import mean_metrics
from rearticulate.bench.evidence_page import evidence
from rearticulate.bench.flow_page import fits
from rearticulate.bench.gate import is_worse, load_facts, regressions
from rearticulate.bench.markdown import table
from rearticulate.bench.pages import PAGES, find_page
from rearticulate.bench.results_page import JOBS, report
from rearticulate.bench.runner import Job, Runner
from rearticulate.bench.variants import VARIANTS, WITHOUT, variant
from rearticulate.bench.worker import run_case
from rearticulate.commands.benching import BenchOptions, choose, run_bench
from rearticulate.errors import FitError, InputError
from rearticulate.io import load_truth
from rearticulate.synth import objects
from rearticulate.synth.articulated import record


def perfect_answer(case, folder):
    truth = case.load(folder)[1]
    return run_case(case, folder, 0, lambda sequence, seed: perfect_fit(sequence, truth, 1))


def test_the_cases_are_all_different_and_found_by_name():
    names = [job.case.name for job in JOBS]
    assert len(names) == len(set(names)) == 16 + 8
    perturbed = [job.case.name for job in robustness_page.JOBS]
    assert len(perturbed) == len(set(perturbed)) == 4 * (1 + len(PERTURBATIONS))
    assert find_case("nao/noise_1mm") == Case("nao", "noise_1mm")


def test_every_object_has_one_place(data_folder):
    objects = [*(name for names in SETS.values() for name in names), *BUNDLED]
    assert len(objects) == len(set(objects))
    assert all(Case(name).path(data_folder).is_file() for name in objects)
    assert {path.name for path in (data_folder / "everyday").glob("*.npz") if ".truth" not in path.name} == {
        f"{name}.npz" for name in EVERYDAY
    }
    assert set(CAPTURED) <= set(CAPTURE)


def test_the_objects_with_slides_are_those_whose_truth_has_one(data_folder):
    truths = {name: load_truth(data_folder / "everyday" / f"{name}.truth.npz") for name in EVERYDAY}
    assert {name for name, truth in truths.items() if "prismatic" in truth.joint_type} == set(WITH_SLIDES)


@pytest.mark.parametrize("change", ["", *PERTURBATIONS, *RETOLD])
def test_a_perfect_fit_is_perfect_in_every_case(data_folder, change):
    answer = perfect_answer(Case("refrigerator", change), data_folder)
    metrics = answer["metrics"]
    assert metrics["recon_cm"] == pytest.approx(0, abs=1e-6)
    assert metrics["rand_index_multi_scan"] == 1
    assert metrics["joint_type_share"] == metrics["true_edges_share"] == metrics["exact"] == 1
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


def some_answer(recon=0.1, seconds=2.0, structure="(r())", **more):
    metrics = {"recon_cm": recon, "rand_index": 0.9, "tree_edit_distance": 1.0, "parts": 3.0, "parts_true": 3.0}
    metrics |= {"tree_edit_distance_best_root": 1.0, "seen_recon_cm": recon, "exact": 1.0, **more}
    answer = {"case": "nao", "seconds": seconds, "stages": {"track": 1.5}, "peak_mb": None, "metrics": metrics}
    return {**answer, "structure": structure}


def test_the_report_shows_what_there_is():
    answers = {"direct/nao": some_answer(0.1), "direct/nao/noise_1mm": some_answer(0.25)}
    text = report({"seed": "0"}, answers)
    assert "**Without a result:** kinova, ur5" in text
    assert "| nao | noise_1mm | 0.250 | 2.50 |" in robustness_page.report({"seed": "0"}, answers)
    assert "| nao | 1.5 | 2.0 |" in text
    assert "mean of all 16" not in text
    assert (
        text.count("| tree edit | exact | reanimate cm |") == text.count("| axis deg | axis z | axis position % |") == 2
    )


def test_means_are_over_the_objects_that_have_the_metric():
    assert mean_metrics([{"x": 1.0, "y": 5.0}, {"x": 3.0}]) == {"x": 2.0, "y": 5.0}
    assert mean_metrics([]) == {}


def test_z_scores_are_pooled_over_joints():
    few = {"axis_z_squared_sum": 16.0, "axis_z_count": 1.0, "axis_z_rms": 4.0}
    many = {"axis_z_squared_sum": 9.0, "axis_z_count": 9.0, "axis_z_rms": 1.0}
    assert mean_metrics([few, many, {"x": 1.0}])["axis_z_rms"] == pytest.approx(2.5**0.5)


def test_a_table_by_hand():
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n| --- | ---: |\n| 1 | 2 |"


def page_of(machine="A", **answers):
    return {"stamp": {"machine": machine, "jobs": "1"}, "answers": answers}


def test_the_gate_names_what_got_worse():
    baseline = page_of(nao=some_answer(0.10), solo=some_answer(0.10))
    now = page_of(nao=some_answer(0.20), solo=some_answer(0.11), a1=some_answer(9.0))
    assert regressions(baseline, now) == ["nao: recon_cm 0.1 -> 0.2"]
    assert regressions(now, baseline) == []
    lost = page_of(nao=some_answer(0.10, exact=0.0), solo=some_answer(0.10, rand_index=0.8))
    assert regressions(baseline, lost) == ["nao: exact 1 -> 0", "solo: rand_index 0.9 -> 0.8"]


def test_the_gate_compares_seconds_and_memory_on_one_machine():
    def slow(seconds, megabytes, machine="A"):
        return page_of(machine, nao={**some_answer(seconds=seconds), "peak_mb": megabytes})

    assert regressions(slow(20.0, 400.0), slow(31.0, 650.0)) == [
        "nao: seconds 20 -> 31",
        "nao: peak_mb 400 -> 650",
    ]
    assert regressions(slow(20.0, 400.0), slow(29.0, 590.0)) == []
    assert regressions(slow(2.0, 100.0), slow(6.9, 290.0)) == []  # little more, whatever the ratio
    assert regressions(slow(20.0, 400.0), slow(99.0, 9e9, "B")) == []
    assert regressions(slow(20.0, None), slow(20.0, 400.0)) == []


def test_the_gate_pools_the_z_scores():
    def z(*squares):
        return page_of(**{f"o{i}": some_answer(axis_z_squared_sum=s, axis_z_count=1.0) for i, s in enumerate(squares)})

    assert regressions(z(1.0, 1.0), z(1.0, 7.0)) == ["all joints: axis_z_rms 1 -> 2"]
    assert regressions(z(1.0, 1.0), z(0.4, 1.7)) == []
    assert regressions(page_of(nao=some_answer()), z(9.0)) == []


@pytest.fixture
def bench(tmp_path, data_folder, monkeypatch):
    """`bench phantoms` in an empty folder, whose fits all answer the same; returns what goes to stderr."""

    def run(answer, capsys, **options):
        monkeypatch.setattr(Runner, "run", lambda self, wanted: {job.name: answer for job in wanted})
        defaults = {"only": frozenset(), "seed": 0, "jobs": 1, "fresh": False, "quick": False, "gate": False}
        run_bench("phantoms", tmp_path, BenchOptions(**{**defaults, "baseline": None, "as_json": False, **options}))
        return capsys.readouterr().err

    return run


COUNTS = dict.fromkeys(("joints_real", "joints_real_sure", "joints_made_up", "joints_sure_wrong"), 1.0)


def test_bench_with_a_gate_compares_with_the_page_as_it_was(bench, tmp_path, capsys):
    page = tmp_path / "phantoms.json"
    good, bad = some_answer(0.1, **COUNTS), some_answer(0.3, **COUNTS)
    with pytest.raises(InputError, match="not the numbers of an earlier benchmark"):
        bench(good, capsys, gate=True)
    bench(good, capsys)
    before = page.read_text()
    assert "nothing got worse in 13 fits (0 more are new)" in bench(good, capsys, gate=True)
    with pytest.raises(FitError, match=r"^13 numbers got worse than in .*phantoms.json$"):
        bench(bad, capsys, gate=True)
    assert "direct/cabinet_c1: recon_cm 0.1 -> 0.3" in capsys.readouterr().err
    assert load_facts(page)["answers"]["direct/cabinet_c1"] == bad  # written all the same
    assert "nothing got worse" in bench(bad, capsys, gate=True)
    kept = tmp_path / "kept.json"
    kept.write_text(before)
    with pytest.raises(FitError, match=r"1 numbers got worse than in .*kept.json"):
        bench(bad, capsys, baseline=kept, only=frozenset({"cabinet_c1"}))
    kept.write_text(before.replace('"machine": "', '"machine": "another '))
    assert "seconds and memory are not compared" in bench({**good, "seconds": 99.0}, capsys, baseline=kept)
    kept.write_text(before.replace("direct/", "other/"))
    with pytest.raises(FitError, match=r"none of these fits is in .*kept.json"):
        bench(good, capsys, baseline=kept)
    for broken in ("[]", "{}", '{"answers": {"direct/nao": 1}}', '{"answers": {"direct/nao": {"metrics": 1}}}', "x"):
        kept.write_text(broken)
        with pytest.raises(InputError, match="not the numbers of an earlier benchmark"):
            bench(good, capsys, baseline=kept)


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
    for page in (p for name, p in PAGES.items() if name not in ("flow", "loops", "evidence")):  # those measure
        text = page.render({"seed": "0"}, {})
        assert text.startswith("# ")
    for name in ("results", "robots", "energies", "designs", "household", "time"):
        assert "published" in PAGES[name].render({"seed": "0"}, {}).lower()
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
    with pytest.raises(InputError, match="no table 'x'; there are results, robustness, everyday"):
        find_page("x")


def test_finished_jobs_are_not_run_again(tmp_path):
    runner = Runner(tmp_path)
    job = Job(Case("nao"))
    runner.path(job).parent.mkdir(parents=True)
    runner.path(job).write_text(json.dumps(some_answer()))
    assert runner.run([job]) == {"direct/nao": some_answer()}
    assert Runner(tmp_path, seed=1).path(job) != runner.path(job)
    assert Runner(tmp_path, seed=1).path(job) == runner.path(Job(Case("nao"), seed=1))
    assert Job(Case("nao"), seed=1).name == "direct/nao seed 1"
    assert Runner(tmp_path, quick=True).path(Job(Case("nao"), "paper")) != runner.path(Job(Case("nao"), "paper"))


def test_fits_with_and_without_the_network_stand_side_by_side():
    answers = {job.name: some_answer(0.1 if job.variant == "direct" else 0.3) for job in PAGES["flow"].jobs}
    table = fits(answers)[1]
    assert "| **mean** | direct | 0.100" in table
    assert "| nao | without network | 0.300" in table


def test_the_everyday_page_has_means_and_medians_by_kind():
    answers = {job.name: some_answer(0.1, true_edges_share=0.5) for job in everyday_page.JOBS}
    answers["direct/cutter"] = some_answer(0.5, exact=0.0)
    text = everyday_page.report({}, answers)
    assert "| cutter *slide* | 0.00 | - | 1.00 | - | 3 of 3 | 0.900 | 0.500 | - | - | 2.0 |" in text
    assert "| **mean of all** (33) | 0.97 | - | 1.00 | 0.50 | - | 0.900 | 0.112 | - | - | 2.0 |" in text
    assert "| **median of objects with slides** | - | - | 1.00 | 0.50 | - | 0.900 | 0.100 |" in text
    assert "| **mean of objects with hinges only** (10) |" in text and "| **mean of robots** (9) |" in text
    del answers["direct/cutter"]
    assert "**mean of all**" not in everyday_page.report({}, answers)


def test_captured_views_stand_beside_the_same_sequence_from_all_around():
    assert Job(Case("nao")) in capture_page.JOBS and len(capture_page.JOBS) == len(set(capture_page.JOBS))
    answers = {job.name: some_answer(0.3) for job in capture_page.JOBS}
    answers["direct/nao"] = some_answer(0.1)
    text = capture_page.report({}, answers)
    assert "| nao_c1 | 0.300 | 0.100 | 3.0 | - | 3 of 3 | 1.00 | 1.00 | - | 2.0 |" in text
    assert "| panda_fixed1 | 0.300 | - | - |" in text
    assert "| cabinet_11views/points_5000 seed 2 | 0.300 |" in text


def test_the_stability_page_counts_what_keeps_its_structure():
    answers = {job.name: some_answer() for job in stability_page.JOBS}
    answers["direct/solo seed 2"] = some_answer(structure="()")
    answers["direct/nao/other_world"] = some_answer(structure="()")
    del answers["direct/stapler/other_world"]
    text = stability_page.report({}, answers)
    cell = "3 of 3, 1, 0.100"
    assert f"| solo | {cell} | {cell} | {cell} | {cell} | no | yes |" in text
    assert f"| nao | {cell} | {cell} | {cell} | {cell} | yes | no |" in text
    assert "| stapler |" in text and "| **share that keeps it** | - | - | - | - | 11 of 12 | 10 of 11 |" in text


def test_the_page_of_mechanisms_leaves_out_one_at_a_time():
    assert "without network" in WITHOUT and "without field" not in WITHOUT
    assert all(VARIANTS[name].relax == VARIANTS[name].articulate == "direct" for name in WITHOUT)
    objects = mechanisms_page.OBJECTS
    answers = {f"direct/{name}": some_answer(0.1) for name in objects}
    answers |= {f"without network/{name}": some_answer(0.1, seconds=1.0) for name in objects}
    answers["without network/solo"] = some_answer(1.6, exact=0.0)
    text = mechanisms_page.report({}, answers)
    assert f"| default | 0.100 | 0.900 | 1.00 | 1.00 | 2.0 | of {len(objects)} |" in text
    assert "| without network | +0.100 | +0.000 | +0.00 | -0.07 | -0.9 | 1 of 15 |" in text
    assert all(name in text for name in objects)


def test_the_score_knows_true_parts_of_a_simple_thing() -> None:
    sequence, truth = record(objects.hinge(), frames=5, points=1200, step_deg=15)
    found = evidence(sequence, truth)
    assert (found.joints, found.paying, found.parts, found.pieces) == (1, 1, 2, 2)
    assert found.rand > 0.95 and found.error < 0.5
