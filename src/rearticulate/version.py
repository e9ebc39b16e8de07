"""Which package this is: its version, and a hash of the code that makes results."""

from __future__ import annotations

import functools
import hashlib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
_CODE = (
    "config.py",
    "evaluation",
    "export",
    "geometry",
    "io",
    "joints",
    "localization",
    "methods",
    "network",
    "observe",
    "parts",
    "pipeline.py",
    "posing",
    "records.py",
    "render",
    "results.py",
    "retargeting",
    "search",
    "shape",
    "synth",
)
_KINDS = (".py", ".safetensors")


def package_version() -> str:
    """The version that is installed; "unknown" where the sources are used without an installation."""
    try:
        return version("rearticulate")
    except PackageNotFoundError:
        return "unknown"


@functools.cache
def code_hash() -> str:
    """Of all files that can change a result."""
    kept = [PACKAGE / name for name in _CODE]
    files = sorted(path for top in kept for path in (top, *top.rglob("*")) if path.suffix in _KINDS)
    return digest(*(part for path in files for part in (str(path.relative_to(PACKAGE)).encode(), path.read_bytes())))


def digest(*parts: bytes) -> str:
    """Twelve letters for some bytes."""
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part)
    return whole.hexdigest()[:12]
