"""Where an optional package is absent, one line says what to install."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from rearticulate.errors import InputError
from rearticulate.extras import EXTRAS, needs


def test_an_absent_package_is_named() -> None:
    told = r'needs the package no_such_module: pip install "rearticulate\[paper\]"'
    with pytest.raises(InputError, match=told), needs("paper"):
        import no_such_module.sub  # type: ignore[import-not-found]  # noqa: F401


def test_the_method_of_the_paper_names_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [name for name in sys.modules if name.startswith("rearticulate.methods.paper")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(InputError, match=r'torch: pip install "rearticulate\[paper\]"'):
        import rearticulate.methods.paper.relax  # noqa: F401


def test_a_fault_of_our_own_is_not_blamed_on_an_extra() -> None:
    with pytest.raises(ModuleNotFoundError), needs("paper"):
        import rearticulate.no_such_module  # type: ignore[import-not-found]  # noqa: F401


SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"
BLOCKED = """
import sys
absent, program, finders = set(sys.argv[1].split(",")), sys.argv[2:], list(sys.meta_path)

class Present:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in absent:
            return None
        return next((spec for f in finders if (spec := f.find_spec(name, path, target)) is not None), None)

    def find_distributions(self, *args):
        for finder in finders:
            yield from getattr(finder, "find_distributions", lambda *_: ())(*args)

sys.meta_path[:] = [Present()]
sys.argv = ["rearticulate", *program]
from rearticulate.cli import main
main()
"""
USERS = {  # commands that need an extra, and what they ask for where no extra is installed
    "export": "export",
    "render, mp4": "video",
    "simulate": "simulate",
    "view": "view",
    "fit, paper": "paper",
    "train-flow": "train",
    "fit": "",
    "bench": "",
    "pose": "",
}


@pytest.mark.parametrize("extra", ["", "export", "view"])
def test_every_command_works_or_names_its_extra(extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The quick form of scripts/check_extras.py: packages of other extras cannot be imported."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    import check_extras  # type: ignore[import-not-found]

    absent = ",".join(module for module, home in EXTRAS.items() if home != extra)
    check_extras.make_inputs(sys.executable, tmp_path)
    for command, wanted in USERS.items():
        found = check_extras.run(command, [sys.executable, "-c", BLOCKED, absent], tmp_path)
        done = "refuses" if command == "bench" else "works"
        assert found == (done if wanted in ("", extra) else f"asks for {wanted}"), command


def test_an_absent_package_is_never_unexpected() -> None:
    with pytest.raises(InputError, match=r'needs the package skimage: pip install "rearticulate\[export\]"'), needs():
        raise ModuleNotFoundError("No module named 'skimage'", name="skimage")
    with pytest.raises(ModuleNotFoundError), needs():
        raise ModuleNotFoundError("No module named 'elsewhere'", name="elsewhere")
