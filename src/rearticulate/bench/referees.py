"""Packages that judge robot descriptions: simcheck (https://pypi.org/project/simcheck) and urdf-validator
(https://pypi.org/project/urdf-validator)."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

PACKAGES = {"simcheck": "simcheck", "urdf_validator": "urdf_validator_main"}
VALIDATOR = "from urdf_validator_main.cli import main; main()"


def referees(path: Path) -> dict[str, float]:
    """How many errors and warnings of a URDF the packages that are installed tell."""
    found = {}
    for judge in (simcheck, urdf_validator):
        if find_spec(PACKAGES[judge.__name__]) is not None:
            errors, warnings = judge(path)
            found |= {f"{judge.__name__}.errors": len(errors), f"{judge.__name__}.warnings": len(warnings)}
    return found


def simcheck(path: Path, engines: tuple[str, ...] = ("mujoco",)) -> tuple[list[str], list[str]]:
    """Errors and warnings of a URDF or an MJCF, one line each."""
    report = import_module("simcheck").check(str(path), engines=engines)
    return [str(found.message) for found in report.errors], [str(found.message) for found in report.warnings]


def urdf_validator(path: Path) -> tuple[list[str], list[str]]:
    """Errors and warnings of a URDF, one line each."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", VALIDATOR, str(path), "--output-dir", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        reports = list(Path(folder).glob("*.json"))
        if not reports:
            return [done.stderr.strip() or f"exit code {done.returncode}"], []
        told = json.loads(reports[0].read_text(encoding="utf-8"))
    return [str(line) for line in told["critical_issues"]], [str(line) for line in told["warnings"]]
