"""Where an optional package is absent, one line says what to install."""

from __future__ import annotations

import sys

import pytest

from rearticulate.errors import InputError
from rearticulate.extras import needs


def test_an_absent_package_is_named() -> None:
    told = r'needs the package no_such_module: pip install "rearticulate\[paper\]"'
    with pytest.raises(InputError, match=told), needs("paper"):
        import no_such_module.sub  # type: ignore[import-not-found]  # noqa: F401


def test_the_method_of_the_paper_names_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [name for name in sys.modules if name.startswith("rearticulate.solver.neural")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(InputError, match=r'torch: pip install "rearticulate\[paper\]"'):
        import rearticulate.solver.neural.relax  # noqa: F401


def test_a_fault_of_our_own_is_not_blamed_on_an_extra() -> None:
    with pytest.raises(ModuleNotFoundError), needs("paper"):
        import rearticulate.no_such_module  # type: ignore[import-not-found]  # noqa: F401
