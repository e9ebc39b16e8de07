"""The public names stay what they are, whatever was used before."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import rearticulate

ROOT = Path(rearticulate.__file__).parent
# Other packages are loaded once; then every ordered pair of names is tried in a process that has nothing of ours yet.
# Names of one home are loaded together, so one of them stands for all as the first of a pair.
SCRIPT = """
import importlib, os, sys
import rearticulate
names, homes = rearticulate.__all__, rearticulate._HOME
for name in names:
    getattr(rearticulate, name)
for module in [m for m in sys.modules if m.split(".")[0] == "rearticulate"]:
    del sys.modules[module]
for first in {homes[name]: name for name in names}.values():
    if (child := os.fork()) == 0:
        import rearticulate
        getattr(rearticulate, first)
        for second in names:
            if (grandchild := os.fork()) == 0:
                getattr(rearticulate, second)
                right = all(getattr(rearticulate, n).__name__ == n and callable(getattr(rearticulate, n))
                            for n in (first, second))
                os._exit(not right)
            if os.waitpid(grandchild, 0)[1]:
                print(first, second, flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


def test_no_public_name_is_a_module() -> None:
    modules = {path.stem for path in ROOT.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert not modules & set(rearticulate.__all__)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_any_two_names_in_any_order() -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert run.stdout.split("\n") == [""], "the second name breaks the first"
