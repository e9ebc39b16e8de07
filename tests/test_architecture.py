"""Imports point one way, and the package itself is quick to import."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rearticulate

ROOT = Path(rearticulate.__file__).parent
ROOMS = (  # folders and files of the package; each imports from those before it alone
    "errors",
    "extras",
    "machine",
    "parallel",
    "progress",
    "version",
    "bounds",
    "jsons",
    "arrays",
    "geometry",
    "schema",
    "invariants",
    "records",
    "config",
    "io",
    "network",
    "observe",
    "parts",
    "joints",
    "search",
    "methods",
    "results",
    "pipeline",
    "posing",
    "retargeting",
    "localization",
    "shape",
    "export",
    "render",
    "report",
    "view",
    "evaluation",
    "synth",
    "training",
    "bench",
    "commands",
    "cli",
)
SOLVER = {"observe", "parts", "joints", "search", "methods"}
UNKNOWN_TO_THE_SOLVER = {"evaluation", "synth", "training"}  # what reads or makes ground truth
HEAVY = ("matplotlib", "plotly", "trimesh", "typer", "loky", "yourdfpy")
HEAVY += ("torch", "safetensors", "ot", "PIL", "viser", "coacd", "pxr", "av")


def modules() -> list[Path]:
    return [path for path in sorted(ROOT.rglob("*.py")) if path != ROOT / "__init__.py"]


def room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported(source: str) -> set[str]:
    """Rooms that a module imports from, anywhere in its source."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports are absolute"
            names = [node.module] if node.module != "rearticulate" else [f"rearticulate.{a.name}" for a in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        found |= {name.split(".")[1] for name in names if name and name.startswith("rearticulate.")}
    return found


def forbidden(own: str, source: str) -> set[str]:
    """Rooms that a module of the room `own` imports from and may not."""
    names = imported(source) - {own}
    after = {name for name in names if ROOMS.index(name) > ROOMS.index(own)}
    return after | (names & UNKNOWN_TO_THE_SOLVER if own in SOLVER else set())


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    found = forbidden(room(path), path.read_text(encoding="utf-8"))
    assert not found, f"{room(path)} may not import from {', '.join(sorted(found))}"


def test_every_room_is_in_the_list() -> None:
    assert {room(path) for path in modules()} == set(ROOMS)


@pytest.mark.parametrize("own", sorted(SOLVER))
@pytest.mark.parametrize("other", sorted(UNKNOWN_TO_THE_SOLVER))
def test_the_solver_may_not_see_ground_truth(own: str, other: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rule bites: at the top of a module or within a function, wherever the room stands in the list."""
    monkeypatch.setitem(globals(), "ROOMS", (other, *(name for name in ROOMS if name != other)))
    for source in (
        f"from rearticulate.{other}.x import y",
        f"from rearticulate import {other}",
        f"import rearticulate.{other}.x",
        f"def late():\n    from rearticulate.{other} import x\n    return x",
    ):
        assert forbidden(own, source) == {other}
    assert forbidden("bench", f"from rearticulate.{other} import x") == set()


def test_an_import_from_a_later_room_is_seen() -> None:
    assert forbidden("geometry", "from rearticulate.records import Motion") == {"records"}
    assert forbidden("records", "from rearticulate.geometry.se3 import exp_se3") == set()
    with pytest.raises(AssertionError, match="absolute"):
        imported("from . import se3")


@pytest.mark.parametrize("module", ["rearticulate", "rearticulate.records", "rearticulate.commands.outcome"])
def test_importing_is_light(module: str) -> None:
    heavy = HEAVY if module != "rearticulate.commands.outcome" else (*tuple(set(HEAVY) - {"typer"}), "numpy", "scipy")
    code = f"import {module}, sys; print(*[m for m in {heavy!r} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.split() == []
