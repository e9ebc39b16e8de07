"""`rearticulate export`: files, refusals in one line, nothing half-written."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from rearticulate.io.model import save_result
from test_cli import one_line, run
from toy_result import toy


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "lamp"
    save_result(folder, *toy(100))
    return folder


def test_every_format_lands_in_the_result(saved: Path) -> None:
    done = run("export", saved)
    assert done.exit_code == 0
    names = {path.name for path in (saved / "export").iterdir()}
    assert names == {"export.json", "lamp.urdf", "lamp.xml", "lamp.usdc", "lamp.glb", "meshes", "parts"}
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["urdf", "mjcf", "usd", "gltf", "ply"]
    told = json.loads((saved / "export" / "export.json").read_text())
    assert [link["name"] for link in told["links"]] == ["base", "arm", "tip"]
    assert all(link["mass_kg"] > 0 for link in told["links"])


def test_an_export_is_replaced_only_when_asked(saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run("export", saved, "-o", out, "--format", "urdf").exit_code == 0
    again = run("export", saved, "-o", out, "--format", "gltf")
    assert again.exit_code == 2 and "earlier export" in one_line(again)
    assert run("export", saved, "-o", out, "--format", "gltf", "--overwrite", "--name", "a b").exit_code == 0
    assert {path.name for path in out.iterdir()} == {"export.json", "a_b.glb"}


def test_json_tells_what_was_written(saved: Path, tmp_path: Path) -> None:
    done = run("export", saved, "-o", tmp_path / "out", "--format", "ply", "--json", "--margin", 0.5)
    told = json.loads(done.stdout)
    assert told["files"] == ["parts"] and told["config"]["margin"] == 0.5


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--format", "step"], "choose from urdf, mjcf, usd, gltf, ply"),
        (["--format", ","], "choose from"),
        (["--density", "0"], "density must be a number above 0"),
        (["--margin", "-1"], "margin must be a number of 0 at least"),
        (["--up", "w"], "--up w: must be x, y or z"),
        (["--collision", "box"], "collision must be one of pieces, hull"),
        (["--max-faces", "3"], "max_faces must be a whole number of 100 at least"),
    ],
)
def test_bad_options_are_one_line(saved: Path, tmp_path: Path, arguments: list[str], what: str) -> None:
    done = run("export", saved, "-o", tmp_path / "out", *arguments)
    assert done.exit_code == 2 and what in one_line(done)
    assert not (tmp_path / "out").exists()


def test_no_result_and_other_folders_are_one_line(saved: Path, tmp_path: Path) -> None:
    assert "no result here" in one_line(run("export", tmp_path / "nothing"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    refused = run("export", saved, "-o", tmp_path / "mine", "--overwrite")
    assert refused.exit_code == 2 and "not an earlier export" in one_line(refused)


def test_an_absent_package_is_named(saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    monkeypatch.delitem(sys.modules, "rearticulate.export.gltf", raising=False)
    done = run("export", saved, "-o", tmp_path / "out", "--format", "gltf")
    assert done.exit_code == 2 and 'pip install "rearticulate[export]"' in one_line(done)
    assert not (tmp_path / "out").exists()
