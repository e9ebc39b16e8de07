"""JSON files from users: one line says what is wrong with one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rearticulate.errors import InputError
from rearticulate.io.npz import one_line


def read_json(path: Path, absent: str = "") -> Any:
    """The value in a file; `absent` is the message where there is none. Raises InputError."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(absent or f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: damaged, not valid JSON ({one_line(error)})") from error
