"""The files that the pages speak of, and the names in them, are there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import rearticulate

ROOT = Path(rearticulate.__file__).parent
REPOSITORY = ROOT.parents[1]
PAGES = [*sorted(REPOSITORY.glob("docs/*.md")), REPOSITORY / "README.md"]
FILE = r"`((?:[a-z_]+/)*[a-z_]+\.py)`"
DEFINED = (ast.FunctionDef, ast.ClassDef)


def defined(path: Path) -> set[str]:
    """Functions, classes, their methods, and constants of a module."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    targets = [t for n in nodes if isinstance(n, ast.Assign) for t in n.targets]
    targets += [n.target for n in nodes if isinstance(n, ast.AnnAssign)]
    return {t.id for t in targets if isinstance(t, ast.Name)} | {n.name for n in nodes if isinstance(n, DEFINED)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(FILE, text):
        assert any((folder / name).is_file() for folder in (ROOT, REPOSITORY)), name
    for file, name in re.findall(rf"{FILE},\s`([A-Za-z_.]+)`(?!\.)", text):
        if not name.endswith(".py"):
            assert name.split(".")[-1] in defined(ROOT / file), f"{name} in {file}"
