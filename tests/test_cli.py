from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from rearticulate.cli import app
from rearticulate.commands.simulating import truth_beside
from rearticulate.errors import FitError, InputError
from rearticulate.io.measure import unit_guess
from rearticulate.io.model import load_result, load_sequence_of, save_result
from rearticulate.io.sequence import save_sequence
from rearticulate.io.stages import StageStore
from rearticulate.io.truth import save_truth
from rearticulate.records import FitResult, PointSequence
from toy_result import toy, toy_truth


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def one_line(result: Result) -> str:
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    return line


@pytest.fixture
def sequence_file(tmp_path: Path) -> Path:
    path = tmp_path / "seq.npz"
    save_sequence(path, toy()[1])
    return path


@pytest.fixture
def fitter(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The pipeline replaced by one that knows the answer; returns what it was called with."""
    calls: list[dict[str, Any]] = []

    def fit(sequence: PointSequence, config: Any, *, progress: Any, store: StageStore, **rest: Any) -> FitResult:
        from dataclasses import asdict, replace

        calls.append({"config": config, "resumed": store.load("track", "mark") is not None, **rest})
        progress("track", 0.5)
        store.save("track", "mark", {"x": np.zeros(1)})
        return replace(toy()[0], config=asdict(config), seed=rest["seed"])

    monkeypatch.setattr("rearticulate.pipeline.fit", fit)
    return calls


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    folder = tmp_path / "saved"
    save_result(folder, *toy())
    return folder


def test_help_and_version_name_every_command() -> None:
    text = subprocess.run(
        [sys.executable, "-m", "rearticulate.cli", "--help"], capture_output=True, text=True, check=True
    ).stdout
    for command in ("fit", "eval", "simulate", "demo", "info"):
        assert command in text
        assert run(command, "--help").exit_code == 0
    assert run("--version").stdout.startswith("rearticulate ")


def test_fit_writes_a_whole_folder_and_shows_the_model(
    sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = run("fit", sequence_file, "-o", out, "--seed", 3, "--canonical", 1)
    assert done.exit_code == 0, done.stderr
    assert {p.name for p in out.iterdir()} >= {"model.json", "report.html", "parts.png", "frames.png", "stages"}
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    assert {"seed": 3, "canonical": 1}.items() <= fitter[0].items()
    for text in ("3 parts", "arm revolute", "tip prismatic", "-11.5 … 22.9°", "not determined", "track 1.5 s"):
        assert text in done.stdout
    assert "track" in done.stderr


def test_fit_json_is_alone_on_stdout(sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path) -> None:
    done = run("fit", sequence_file, "-o", tmp_path / "out", "--json", "--no-report")
    answer = json.loads(done.stdout)
    assert [p["name"] for p in answer["parts"]] == ["base", "arm", "tip"]
    assert answer["joints"][1]["origin_std"] is None
    assert not (tmp_path / "out" / "report.html").exists()
    assert fitter[0]["canonical"] is None


def test_settings_come_from_preset_and_file(sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path) -> None:
    settings = tmp_path / "settings.json"
    settings.write_text('{"canonical_tries": 1}')
    assert run("fit", sequence_file, "-o", tmp_path / "out", "--config", settings, "--no-report").exit_code == 0
    assert fitter[0]["config"].canonical_tries == 1


def test_an_earlier_result_is_replaced_on_request_only(
    sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path
) -> None:
    fit = ("fit", sequence_file, "-o", tmp_path / "out", "--no-report")
    assert run(*fit).exit_code == 0
    refused = run(*fit)
    assert refused.exit_code == 2
    assert "earlier result" in one_line(refused)
    assert run(*fit, "--overwrite").exit_code == 0
    assert [call["resumed"] for call in fitter] == [False, False]


def test_a_stopped_fit_goes_on(
    sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    fit = ("fit", sequence_file, "-o", out, "--no-report")

    def stop(*args: Any, **kwargs: Any) -> None:
        StageStore(out / "stages").save("track", "mark", {"x": np.zeros(1)})
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("rearticulate.pipeline.fit", stop)
        stopped = run(*fit)
    assert stopped.exit_code == 130
    assert one_line(stopped) == "interrupted; --resume goes on from here"
    assert [p.name for p in out.iterdir()] == ["stages"]
    assert run(*fit, "--resume").exit_code == 0
    assert fitter[-1]["resumed"]
    again = run(*fit, "--resume")
    assert (again.exit_code, len(fitter)) == (0, 1)
    assert "complete already" in again.stderr
    other = run(*fit, "--resume", "--seed", 5)
    assert other.exit_code == 2
    assert "other settings" in one_line(other)
    moved = tmp_path / "moved.npz"
    with np.load(sequence_file) as stored:
        np.savez(moved, points=stored["points"] + 0.1)
    other = run("fit", moved, "-o", out, "--no-report", "--resume")
    assert other.exit_code == 2
    assert "another sequence" in one_line(other)


def test_a_report_that_cannot_be_written_leaves_the_result(
    sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*args: Any, **kwargs: Any) -> None:
        raise OSError(28, "No space left on device")

    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr("rearticulate.commands.fitting.write_report", full)
        done = run("fit", sequence_file, "-o", out)
    assert done.exit_code == 0
    assert "warning: [Errno 28] No space left on device; the result is complete without it" in done.stderr
    assert load_result(out).model.names == toy()[0].model.names
    assert (out / "frames.png").exists()
    assert not (out / "report.html").exists()
    assert run("fit", sequence_file, "-o", out, "--resume").exit_code == 0
    assert (out / "report.html").exists()
    assert len(fitter) == 1


@pytest.mark.parametrize(
    ("absent", "begun"),
    [
        (("report.html", "frames.png", "parts.png"), "parts.png"),
        (("report.html", "frames.png"), "frames.png"),
        (("report.html",), "report.html"),
        ((), "report.html"),
        (("model.json", "report.html"), "stages/relaxed-0.npz"),
    ],
)
def test_what_a_kill_left_in_the_folder_is_completed_and_goes(
    absent: tuple[str, ...], begun: str, sequence_file: Path, fitter: list[dict[str, Any]], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert run("fit", sequence_file, "-o", out).exit_code == 0
    whole = {path.relative_to(tmp_path) for path in tmp_path.rglob("*")}
    for name in absent:
        (out / name).unlink()
    for suffix in ("lock", "partial"):
        path = out / begun
        path.with_name(f".{path.name}.rearticulate.{suffix}").write_bytes(b"a part")
    more = ["--overwrite"] if "model.json" in absent else []
    assert run("fit", sequence_file, "-o", out, "--resume", *more).exit_code == 0
    assert {path.relative_to(tmp_path) for path in tmp_path.rglob("*")} == whole


def test_a_folder_in_use_is_told_before_anything_is_read(
    sequence_file: Path, fitter: list[dict[str, Any]], saved: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code = "import sys\nfrom rearticulate.io.atomic import reserve\nwith reserve(sys.argv[1]):\n"
    code += "    print('mine', flush=True)\n    sys.stdin.read()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code, str(out)], **pipes) as other:  # type: ignore[call-overload]
        assert other.stdout.readline().strip() == b"mine"
        for command in (
            ("fit", "no-such-input.npz", "-o", out),
            ("track", saved, "no-such-scans.npz", "-o", out),
            ("export", saved, "-o", out, "--format", "ply"),
            ("demo", "-o", out),
        ):
            refused = run(*command)
            assert (refused.exit_code, one_line(refused)) == (2, f"error: {out}: in use by another run")
        other.stdin.close()
    assert fitter == []
    assert not out.exists()


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (InputError("frame 3: has 2 points"), 2, "error: frame 3: has 2 points"),
        (FitError("the fit did not\nconverge"), 1, "error: the fit did not converge"),
        (OSError(28, "No space left on device", "x.npz"), 1, "error: x.npz: No space left on device"),
        (ZeroDivisionError("oh"), 1, "error: unexpected ZeroDivisionError: oh (REARTICULATE_DEBUG=1 tells more)"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_failures_are_one_line_and_a_code(
    error: BaseException, code: int, text: str, sequence_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: Any, **kwargs: Any) -> None:
        raise error

    monkeypatch.delenv("REARTICULATE_DEBUG", raising=False)
    monkeypatch.setattr("rearticulate.pipeline.fit", fail)
    failed = run("fit", sequence_file, "-o", tmp_path / "out")
    assert (failed.exit_code, one_line(failed)) == (code, text)
    assert not (tmp_path / "out").exists()


def test_debugging_shows_the_error_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REARTICULATE_DEBUG", "1")
    assert isinstance(run("info", "nowhere.npz").exception, InputError)


@pytest.mark.parametrize(
    "options",
    [
        ("--device", "cuda"),
        ("--device", "tpu"),
        ("--canonical", "first"),
        ("--canonical", "-1"),
        ("--preset", "nope"),
        ("--config", "nowhere.json"),
        ("--scale", "0"),
        ("--max-points", "0"),
    ],
)
def test_wrong_options_are_bad_input(options: tuple[str, str], sequence_file: Path, tmp_path: Path) -> None:
    wrong = run("fit", sequence_file, "-o", tmp_path / "out", *options)
    assert wrong.exit_code == 2
    assert one_line(wrong).startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments", [("fit",), ("fit", "x", "--nope"), ("nope",), ("info", "nowhere.npz"), ("eval", "a", "b")]
)
def test_wrong_usage_exits_2(arguments: tuple[str, ...]) -> None:
    wrong = run(*arguments)
    assert wrong.exit_code == 2
    assert one_line(wrong).startswith("error: ")


@pytest.mark.parametrize(
    "option",
    [("--seed", "-1"), ("--seed", str(2**70)), ("--seed", "x"), ("--scale", "nan"), ("--scale", "1e300"),
     ("--canonical", "٣")],
)  # fmt: skip
def test_numbers_out_of_range_are_bad_input(option: tuple[str, str], sequence_file: Path, tmp_path: Path) -> None:
    wrong = run("fit", sequence_file, "-o", tmp_path / "out", *option)
    assert wrong.exit_code == 2 and one_line(wrong).startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("value", ["1e400deg", "1e300", "9" * 400, "1e200%"])
def test_no_cloud_of_infinite_numbers_is_written(value: str, saved: Path, tmp_path: Path) -> None:
    wrong = run("pose", saved, "-o", tmp_path / "posed.ply", "--joint", f"arm={value}")
    assert wrong.exit_code == 2 and "must be a number" in one_line(wrong)
    broken = PointSequence.from_arrays(np.full((2, 9, 3), 1e39))  # no float32
    with pytest.raises(FitError, match="finite"):
        save_sequence(tmp_path / "seq.npz", broken)
    assert not (tmp_path / "posed.ply").exists() and not (tmp_path / "seq.npz").exists()


def test_warnings_are_one_line_each(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(3, 150, 3))
    points[1, 4] = np.nan
    np.savez(tmp_path / "seq.npz", points=points)
    done = run("info", tmp_path / "seq.npz", "--json")
    assert json.loads(done.stdout)["points"] == [150, 149, 150]
    (line,) = done.stderr.splitlines()
    assert line.startswith("warning: ")


def test_info_of_a_sequence(sequence_file: Path) -> None:
    facts = json.loads(run("info", sequence_file, "--json").stdout)
    assert (facts["kind"], facts["frames"], facts["points"]) == ("sequence", 4, [360] * 4)
    assert len(facts["size"]) == 3
    assert 0 < facts["spacing"] < 0.05
    assert facts["unit_guess"] == "metres"
    assert "points a frame  360" in run("info", sequence_file).stdout


def test_info_of_a_model_and_of_the_truth(saved: Path, tmp_path: Path) -> None:
    for target in (saved, saved / "model.json"):
        assert [j["type"] for j in json.loads(run("info", target, "--json").stdout)["joints"]] == [
            "revolute",
            "prismatic",
        ]
    assert "arm revolute" in run("info", saved).stdout
    save_truth(tmp_path / "seq.truth.npz", toy_truth())
    assert json.loads(run("info", tmp_path / "seq.truth.npz", "--json").stdout)["parent"] == [-1, 0, 1]


def test_eval_needs_the_folder_and_the_truth_only(saved: Path, tmp_path: Path) -> None:
    save_truth(tmp_path / "seq.truth.npz", toy_truth())
    done = run("eval", saved, tmp_path / "seq.truth.npz", "--json")
    metrics = json.loads(done.stdout)
    assert metrics["recon_cm"] == pytest.approx(0.0, abs=1e-9)
    for key in ("recon", "epe", "acc", "rand", "tree", "reanim"):
        assert any(key in name for name in metrics)
    assert "recon_cm" in run("eval", saved, tmp_path / "seq.truth.npz").stdout


def test_the_sequence_is_kept_with_the_result(saved: Path) -> None:
    sequence = load_sequence_of(saved)
    for kept, original in zip(sequence.points, toy()[1].points, strict=True):
        np.testing.assert_array_equal(kept, original)
    assert load_result(saved).model.names == ("base", "arm", "tip")


@pytest.mark.parametrize(
    ("diagonal", "unit"), [(0.5, "metres"), (60.0, "centimetres"), (900.0, "millimetres"), (1e-4, "unknown")]
)
def test_unit_guess(diagonal: float, unit: str) -> None:
    assert unit_guess(diagonal)[0] == unit


def test_the_truth_of_a_simulation_lies_beside_it() -> None:
    assert truth_beside(Path("a/b.c.npz")) == Path("a/b.c.truth.npz")
    for wrong in ("seq.ply", "seq.truth.npz"):
        with pytest.raises(InputError):
            truth_beside(Path(wrong))


URDF = """<robot name="door">
<link name="frame"><visual><geometry><box size="1 0.1 1"/></geometry></visual></link>
<link name="leaf"><visual><origin xyz="0.5 0 0"/><geometry><box size="1 0.05 1"/></geometry></visual></link>
<joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/><origin xyz="0.5 0 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_simulate_writes_sequence_and_truth(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    (tmp_path / "door.urdf").write_text(URDF)
    simulate = ("simulate", tmp_path / "door.urdf", "-o", tmp_path / "door.npz", "--frames", 3, "--points", 200)
    done = run(*simulate, "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["parts"] == 2
    assert json.loads(run("info", tmp_path / "door.npz", "--json").stdout)["points"] == [200] * 3
    assert json.loads(run("info", tmp_path / "door.truth.npz", "--json").stdout)["parts"] == 2
    assert run(*simulate).exit_code == 2
