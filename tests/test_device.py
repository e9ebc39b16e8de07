"""Where a fit computes: a GPU without use or that is missing is refused at once; no tensor is elsewhere by accident."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import rearticulate
from rearticulate.config import FitConfig, preset
from rearticulate.errors import InputError
from rearticulate.methods.device import choose_device

torch = pytest.importorskip("torch")

PAPER = Path(rearticulate.__file__).parent / "methods" / "paper"
MAKERS = {"tensor", "zeros", "ones", "empty", "full", "eye", "rand", "randn", "arange", "linspace", "as_tensor"}


def test_auto_and_cpu_are_the_cpu() -> None:
    assert {choose_device(name, preset(p)) for name in ("auto", "cpu") for p in ("direct", "paper")} == {"cpu"}


def test_what_cannot_be_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="not 'tpu'"):
        choose_device("tpu", FitConfig())
    with pytest.raises(InputError, match="the direct solver runs on the CPU"):
        choose_device("cuda", FitConfig())
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match="no CUDA device here"):
        choose_device("cuda", preset("paper-fast"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert choose_device("cuda", preset("paper-fast")) == "cuda"


@pytest.mark.parametrize("path", sorted(PAPER.glob("*.py")), ids=lambda path: path.name)
def test_every_new_tensor_names_its_device(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in {f"torch.{name}" for name in MAKERS}:
            assert "device" in {keyword.arg for keyword in node.keywords}, f"line {node.lineno}: {ast.unparse(node)}"
