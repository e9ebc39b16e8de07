"""Imports point one way, and the package itself is quick to import."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rearticulate

ROOT = Path(rearticulate.__file__).parent
LAYERS = [
    {"errors", "extras", "machine", "parallel", "version"},
    {"bounds"},
    {"jsons", "geometry"},
    {"schema", "invariants"},
    {"records"},
    {"config"},
    {"io", "solver", "network", "pose", "evaluation", "synth"},
    {"results"},
    {"pipeline"},
    {"shape"},
    {"export"},
    {"render"},
    {"report", "bench", "view"},
    {"commands"},
    {"cli"},
]
HEAVY = ("matplotlib", "plotly", "trimesh", "typer", "loky", "yourdfpy")
HEAVY += ("torch", "safetensors", "ot", "PIL", "viser", "coacd", "pxr", "av")


def layer(name: str) -> int:
    return next(i for i, names in enumerate(LAYERS) if name in names)


def modules() -> list[Path]:
    return [path for path in sorted(ROOT.rglob("*.py")) if path != ROOT / "__init__.py"]


def imported(path: Path) -> set[str]:
    """First names below `rearticulate` that a module imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names = [node.module] if node.module != "rearticulate" else [f"rearticulate.{a.name}" for a in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        found |= {name.split(".")[1] for name in names if name and name.startswith("rearticulate.")}
    return found


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    own = path.relative_to(ROOT).parts[0].removesuffix(".py")
    upward = [name for name in imported(path) if layer(name) > layer(own)]
    assert not upward, f"{own} may not import {', '.join(upward)}"


@pytest.mark.parametrize("module", ["rearticulate", "rearticulate.records", "rearticulate.commands.outcome"])
def test_importing_is_light(module: str) -> None:
    heavy = HEAVY if module != "rearticulate.commands.outcome" else (*tuple(set(HEAVY) - {"typer"}), "numpy", "scipy")
    code = f"import {module}, sys; print(*[m for m in {heavy!r} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.split() == []
