"""What a number depends on: code, configuration, seed, machine."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from dataclasses import asdict
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rearticulate.config import FitConfig
from rearticulate.version import PACKAGE, code_hash, digest, package_version

_LIBRARIES = ("numpy", "scipy", "numba", "torch")


def config_hash(config: FitConfig) -> str:
    return digest(json.dumps(asdict(config), sort_keys=True).encode())


def stamp(configs: dict[str, FitConfig], seed: int, jobs: int) -> dict[str, str]:
    """One line each, for the head of the results. configs: by their names."""
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "version": package_version(),
        "commit": _commit(),
        "code": code_hash(),
        "configuration": ", ".join(f"{name} {config_hash(config)}" for name, config in configs.items()),
        "seed": str(seed),
        "jobs": str(jobs),
        "machine": f"{_cpu()}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}",
        "libraries": ", ".join(f"{name} {found}" for name in _LIBRARIES if (found := _installed(name))),
    }


def _installed(name: str) -> str:
    """Version of a package, empty if it is absent."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _commit() -> str:
    """Short commit; says so when the sources differ from it."""
    commit = _git("rev-parse", "--short", "HEAD")
    return f"{commit} with changes" if _git("status", "--porcelain", "--", ".") else commit


def _git(*arguments: str) -> str:
    try:
        done = subprocess.run(["git", *arguments], cwd=PACKAGE, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
