"""A result names what it was made on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from rearticulate import machine


def test_the_cpu_comes_first_then_every_kernel_of_linear_algebra() -> None:
    np.linalg.inv(np.eye(3))
    told = machine.machine()
    assert told.startswith(machine.cpu())
    kernels = [found.get("architecture") for found in threadpool_info() if found["user_api"] == "blas"]
    assert all(kernel in told for kernel in kernels if kernel)


def test_the_first_processor_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "CPUINFO", tmp_path / "cpuinfo")
    assert machine.cpu()
    machine.CPUINFO.write_text("processor : 0\nmodel name\t: Abacus 9: fast\n\nprocessor : 1\nmodel name\t: Other\n")
    assert machine.cpu() == "Abacus 9: fast"
