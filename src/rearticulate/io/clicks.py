"""Click files: JSON with points of an object and where they should go, m.

    {"clicks": [{"source": [0.1, 0.2, 0.3], "target": [0.1, 0.4, 0.3], "part": "part_4"}, ...]}

"part" may be left out: the nearest part is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError
from rearticulate.jsons import json_array, read_json
from rearticulate.records import Array

MOST = 2000  # clicks of a file; a posture has some tens of values


@dataclass(frozen=True)
class Clicks:
    """source (K, 3) and target (K, 3), m; part: K names, or None where the file names none."""

    source: Array
    target: Array
    part: tuple[str | None, ...]


def load_clicks(path: Path) -> Clicks:
    """Read a file of clicks. Raises InputError that names the click."""
    record = read_json(path)
    clicks = record.get("clicks") if isinstance(record, dict) else None
    if not isinstance(clicks, list) or not clicks:
        raise InputError(f'{path}: no clicks; give {{"clicks": [{{"source": [x, y, z], "target": [x, y, z]}}, ...]}}')
    if len(clicks) > MOST:
        raise InputError(f"{path}: {len(clicks)} clicks, at most {MOST} are taken; a few determine a posture")
    for k, click in enumerate(clicks):
        if not isinstance(click, dict):
            raise InputError(f'{path}: click {k} must have "source" and "target"')
    source = np.array([_point(path, k, click, "source") for k, click in enumerate(clicks)])
    target = np.array([_point(path, k, click, "target") for k, click in enumerate(clicks)])
    return Clicks(source, target, tuple(_part(path, k, click) for k, click in enumerate(clicks)))


def _point(path: Path, k: int, click: dict[str, Any], key: str) -> Array:
    return json_array(click.get(key), (3,), f"{path}: {key} of click {k}")


def _part(path: Path, k: int, click: dict[str, Any]) -> str | None:
    part = click.get("part")
    if part is not None and not isinstance(part, str):
        raise InputError(f"{path}: part of click {k} must be the name of a part")
    return part
