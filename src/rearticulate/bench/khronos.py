"""The glTF validator of the Khronos group, an npm package (https://github.com/KhronosGroup/glTF-Validator)."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

VALIDATOR = "gltf-validator@2.0.0-dev.3.10"
SECONDS = 120  # for the installation
SCRIPT = """
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[1]));
require("gltf-validator").validateBytes(bytes).then((found) => console.log(JSON.stringify(found.issues)));
"""


def validate(path: Path) -> dict[str, Any] | None:
    """What it says of a file: numErrors, numWarnings, messages. None where it cannot be installed."""
    folder = _installed()
    if folder is None:
        return None
    command = ["node", "-e", SCRIPT, str(path.resolve())]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder.name).stdout)


@cache
def _installed() -> tempfile.TemporaryDirectory[str] | None:
    """A folder in which node finds it, for this process."""
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        return None
    folder = tempfile.TemporaryDirectory()
    try:
        command = [npm, "install", "--silent", "--prefix", folder.name, VALIDATOR]
        subprocess.run(command, capture_output=True, check=True, timeout=SECONDS)
    except (subprocess.SubprocessError, OSError):
        return None
    return folder
