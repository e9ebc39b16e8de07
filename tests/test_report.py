from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rearticulate.io.palette import part_hex
from rearticulate.records import FitResult, JointDiagnostics, Metric, PointSequence
from rearticulate.render.camera import View
from rearticulate.render.stills import write_pictures
from rearticulate.report.advice import advice
from rearticulate.report.confidence import confidence
from rearticulate.report.html import Score, write_report
from rearticulate.report.scene import animation, named_axes, true_parts
from rearticulate.report.summary import headline, joint_rows, jsonable, length, result_as_dict
from rearticulate.report.support import support
from toy_result import FRAMES, toy, toy_truth

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    result, sequence = toy(names=("base", "</script> & arm", "tip"))
    metrics = [Metric("recon_cm", 0.07, "cm", "lower")]
    score = Score(metrics, toy_truth().labels[result.model.canonical])
    result = replace(result, notes=("stopped at <3> parts",))
    path = write_report(tmp_path_factory.mktemp("run"), result, sequence, score, title="a <toy>")
    assert path.name == "report.html"
    return path.read_text(encoding="utf-8")


def test_the_page_needs_no_network(page: str) -> None:
    tags = re.findall(r"<(?:script|link|img|iframe|object)\b[^>]*>", page)
    assert not [tag for tag in tags if re.search(r"\b(?:src|href|data)\s*=", tag)]
    assert "@import" not in page.split("</style>", maxsplit=1)[0]


def test_the_page_tells_everything_and_escapes_names(page: str) -> None:
    body = page.split("<script>", maxsplit=1)[0]
    for text in ("a &lt;toy&gt;", "base", "&lt;/script&gt; &amp; arm", "tip", "recon_cm", "moves within the noise"):
        assert text in body
    assert "1 revolute, 1 prismatic" in body
    assert "stopped at &lt;3&gt; parts" in body
    assert "$" not in body
    assert page.count("</script>") == 3


def test_the_figures_are_json_of_every_frame_and_part(page: str) -> None:
    figures = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    assert figures
    content = json.loads(figures.group(1))
    assert set(content) == {"animation", "parts", "flow", "misfit", "residual", "energy", "time", "truth"}
    assert len(content["animation"]["frames"]) == FRAMES
    assert [trace["name"] for trace in content["parts"]["data"]] == [
        "base",
        "&lt;/script&gt; &amp; arm",
        "tip",
        "joint axes",
    ]


def test_large_frames_are_thinned_for_the_animation() -> None:
    result, sequence = toy(points=3000)
    figure = animation(result, sequence)
    shown = sum(len(trace["x"]["bdata"]) * 3 // 4 // 4 for trace in figure["data"][:-1])
    assert 1900 < shown < 2100


def test_one_rigid_body_has_a_report_too(tmp_path: Path) -> None:
    result, sequence = rigid_body()
    page = write_report(tmp_path, result, sequence).read_text(encoding="utf-8")
    assert "One rigid body: no joints." in page
    assert all(path.read_bytes()[:4] == PNG for path in write_pictures(tmp_path, result, sequence))


def rigid_body() -> tuple[FitResult, PointSequence]:
    result, sequence = toy()
    model = result.model
    one = replace(
        model,
        parent=model.parent[:1],
        joint_type=model.joint_type[:1],
        axis=model.axis[:1],
        origin=model.origin[:1],
        limits=model.limits[:1],
        names=model.names[:1],
        labels=np.zeros_like(model.labels),
    )
    motion = replace(result.motion, q=result.motion.q[:, :1])
    labels = (one.labels,) * FRAMES
    return replace(result, model=one, motion=motion, joints=result.joints[:1], labels=labels), sequence


def test_true_parts_have_the_colours_of_the_parts_that_were_found() -> None:
    result, _ = toy()
    swapped = np.array([2, 0, 1])[result.model.labels]
    swapped[:5] = 3  # a true part that was not found
    colors = {trace["name"]: trace["marker"]["color"] for trace in true_parts(result, swapped)["data"]}
    found = part_hex(5)
    assert [colors[f"true part {t}"] for t in (2, 0, 1)] == found[:3]
    assert colors["true part 3"] not in found[:3]


def test_support_is_whole_where_all_was_measured_and_less_where_not() -> None:
    result, sequence = toy()
    seen = support(result, sequence)
    assert (seen.of_frames() == 1).all() and (seen.misfit() < 1e-9).all()
    kept = result.model.labels != 2  # frame 3 does not show the tip, nor half of the arm
    kept[150:240] = False
    points = (*sequence.points[:3], sequence.points[3][kept])
    labels = (*result.labels[:3], result.labels[3][kept])
    seen = support(replace(result, labels=labels), replace(sequence, points=points))
    assert (seen.of_frames()[:3] == 1).all() and seen.of_frames()[3] < 0.75
    assert seen.of_parts(3)[3].argmin() == 2 and seen.of_parts(3)[3, 0] == 1


def advised(result: FitResult, sequence: PointSequence) -> dict[str, str]:
    return {
        item.about: f"{item.finding} | {item.remedy}" for item in advice(result, sequence, support(result, sequence))
    }


def test_advice_names_what_is_uncertain_and_the_scan_that_would_settle_it() -> None:
    result, sequence = toy()
    told = advised(result, sequence)
    assert set(told) == {"joint of tip"}
    assert (
        "moves within the noise" in told["joint of tip"]
        and "move tip further than the 90 mm seen" in told["joint of tip"]
    )
    sure, arm, tip = result.joints
    arm = replace(arm, runner_up_margin=3.0)
    tip = replace(tip, determined=True, note="", axis_std=0.1)
    told = advised(replace(result, joints=(sure, arm, tip)), sequence)
    assert "revolute or prismatic: the data hardly tell" in told["joint of arm"]
    assert "known to ±5.7° only" in told["joint of tip"]
    hidden = replace(tip, determined=False, note="its motion leaves the surface where it is")
    assert (
        "put something on tip that sticks out"
        in advised(replace(result, joints=(sure, arm, hidden)), sequence)["joint of tip"]
    )
    small = replace(arm, observed_range=0.05, runner_up_margin=1e3)
    assert "it moved by 2.9° only" in advised(replace(result, joints=(sure, small, tip)), sequence)["joint of arm"]


def test_advice_names_frames_and_parts_that_were_not_covered() -> None:
    result, sequence = toy()
    kept = result.model.labels == 0
    points = (*sequence.points[:3], sequence.points[3][kept])
    labels = (*result.labels[:3], result.labels[3][kept])
    told = advised(replace(result, labels=labels), replace(sequence, points=points))
    assert "of the object seen | cover the side that is missing" in told["frame 3"]
    kept = (result.model.labels != 2) | (np.arange(360) % 4 > 0)
    few = tuple(points[kept][::3] for points in sequence.points)
    told = advised(
        replace(result, labels=tuple(labels[kept][::3] for labels in result.labels)), replace(sequence, points=few)
    )
    assert "30 points a frame" in told["tip"] and "scan denser" in told["tip"]
    worse = replace(result, residual=np.array([1e-3, 1e-3, 9e-3, 1e-3]))
    assert "take more frames there" in advised(worse, sequence)["frame 2"]


def test_pictures(tmp_path: Path) -> None:
    for path in write_pictures(tmp_path, *toy()):
        assert path.read_bytes()[:4] == PNG


def test_axes_are_drawn_on_their_parents() -> None:
    result, _ = toy()
    poses = result.model.forward(result.motion.q)
    segments, names = named_axes(result.model, poses[3])
    assert names == ["arm: revolute", "tip: prismatic"]
    middle = segments.mean(axis=1)
    np.testing.assert_allclose(middle[0], result.model.origin[1], atol=1e-12)
    turned = poses[3, 1] @ [*result.model.origin[2], 1.0]
    np.testing.assert_allclose(middle[1], turned[:3], atol=1e-12)


def test_projection_is_a_rotation_with_z_up() -> None:
    R = View().R.T
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert R[2, 0] == pytest.approx(0.0)
    assert R[2, 1] > 0.9


def test_joint_rows_have_units_and_say_what_is_not_known() -> None:
    arm, tip = joint_rows(toy()[0])
    assert (arm.range, arm.residual, arm.uncertainty) == ("-11.5 … 22.9°", "0.4 mm", "±0.11° ±0.3 mm")
    assert arm.note == "revolute, sure (prismatic fits worse by 1,234 χ²)"
    assert (tip.kind, tip.range, tip.uncertainty) == ("prismatic", "-3.00 … 6.00 cm", "±∞")
    assert tip.note == "not determined: moves within the noise"


@pytest.mark.parametrize(
    ("margin", "words"),
    [
        (375.4, "prismatic, sure (revolute fits worse by 375 χ²)"),
        (3.0, "prismatic or revolute: the data hardly tell"),
        (-0.5, "prismatic or revolute: the data hardly tell"),
        (float("inf"), "prismatic, sure (a revolute joint would need an axis outside of the object)"),
        (None, "prismatic, revolute not tried"),
    ],
)
def test_the_type_is_told_and_how_sure_it_is(margin: float | None, words: str) -> None:
    joint = JointDiagnostics(None, 0.1, 0.01, None, "revolute", margin, True)
    assert confidence("prismatic", joint) == words


def test_what_was_not_measured_is_said_so_and_starts_no_alarm() -> None:
    result, sequence = toy()
    unknown = JointDiagnostics(None, 1.6, None, None, "prismatic", None, True)  # a door without points of its own
    result = replace(result, joints=(result.joints[0], unknown, result.joints[1]))
    row = joint_rows(result)[0]
    assert (row.residual, row.uncertainty) == ("–", "–")
    assert "hardly tell" not in row.note and advised(result, sequence) == {}
    assert json.loads(json.dumps(jsonable(result_as_dict(result))))["joints"][0]["runner_up_margin"] is None


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (0.0, "0 mm"),
        (1e-12, "0 mm"),
        (0.00123, "1.23 mm"),
        (0.5, "50 cm"),
        (2.5, "2.5 m"),
        (None, "–"),
        (float("inf"), "∞"),
    ],
)
def test_lengths(metres: float | None, text: str) -> None:
    assert length(metres) == text


def test_a_result_is_strict_json() -> None:
    text = json.dumps(jsonable(result_as_dict(toy()[0])), allow_nan=False)
    joints = json.loads(text)["joints"]
    assert joints[1]["origin_std"] is None and joints[1]["axis_std"] == "inf"
    assert joints[1]["confidence"] == "not determined: moves within the noise"
    assert [j["part"] for j in joints] == ["arm", "tip"]


def test_notes_and_the_machine_are_told() -> None:
    told = result_as_dict(replace(toy()[0], notes=("a note",), machine="a CPU"))
    assert told["notes"] == ["a note"] and told["machine"] == "a CPU"


@pytest.mark.parametrize(
    ("source", "working", "words"),
    [
        ((), 5000, "360 points"),
        ((900,) * FRAMES, 5000, "900 points, 360 kept"),
        ((900, 900, 800, 900), 100, "800 to 900 points, 360 kept, 100 take part in the fit"),
    ],
)
def test_points_in_the_source_kept_and_fitted_are_told_apart(source: tuple[int, ...], working: int, words: str) -> None:
    result, sequence = toy()
    result, sequence = replace(result, config={"working_points": working}), replace(sequence, source_points=source)
    assert f"{FRAMES} frames of {words}" in headline(result, sequence)
    told = result_as_dict(result, sequence)["points"]
    assert told["source"] == list(source or told["kept"]) and told["fitted"] == [min(360, working)] * FRAMES


def test_misfit_is_what_exceeds_the_sampling_and_energy_says_whose_it_is() -> None:
    result = replace(toy()[0], residual=np.array([5.0, 3.0, 1.0, 2.0]), sampling=np.array([4.0, 3.0, 2.0, 0.0]))
    assert result_as_dict(result)["misfit"] == [3.0, 0.0, 0.0, 2.0]
    assert result_as_dict(toy()[0])["misfit"] is None
    assert "energy 0.4 a point" in headline(result)
    assert "energy 0.4 of the paper (E_project + E_group)" in headline(replace(result, config={"articulate": "paper"}))
