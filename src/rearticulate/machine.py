"""What a result was made on: the same seed gives the same bits on one type of CPU and one kernel of linear algebra."""

from __future__ import annotations

import platform
from pathlib import Path

from threadpoolctl import threadpool_info

CPUINFO = Path("/proc/cpuinfo")


def machine() -> str:
    """The CPU, then each linear algebra library with the kernel that it chose: "AMD EPYC 7763, openblas 0.3.28 Zen"."""
    libraries = {_library(found) for found in threadpool_info() if found["user_api"] == "blas"}
    return ", ".join([cpu(), *sorted(libraries)])


def cpu() -> str:
    """The name that the processor gives itself; where the system does not tell, that of its kind."""
    try:
        lines = CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (named[0] if named else "") or platform.processor() or platform.machine() or "unknown CPU"


def _library(found: dict[str, str]) -> str:
    return " ".join(filter(None, (found.get(key) for key in ("internal_api", "version", "architecture"))))
