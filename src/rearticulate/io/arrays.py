"""The frames in an `.npz` or `.npy`.

They are an array (F, N, C) called `points` or alone in its file; or one (N, C) array a frame, the names alike but for
their numbers (frame_0, frame_1; arr_0, arr_1; points_000, points_001, ... before all others). Of C = 3, 4, 6, 7, 9 or
10 columns the first three are x y z. What says where sensors stood is no frame (see `io.sensors`). Nothing else is
guessed: where two kinds of arrays could be the frames, none is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rearticulate.errors import InputError
from rearticulate.io.npz import Archive, ArrayHeader, open_numpy
from rearticulate.io.order import in_order
from rearticulate.io.readers import Points
from rearticulate.io.sensors import is_of_sensors
from rearticulate.io.text import COLUMNS

SHAPES = "one (F, N, 3) array called points, or one (N, 3) array a frame"


def frames_in_arrays(path: Path, max_bytes: int) -> Iterator[tuple[str, Points]]:
    """(name, array as stored) of each frame. Raises InputError where it is not clear which arrays are frames."""
    with open_numpy(path, max_bytes) as content:
        yield from _named_frames(path, content) if isinstance(content, Archive) else _frames_of_array(path, content)


def _frames_of_array(path: Path, array: Any) -> Iterator[tuple[str, Points]]:
    if array.ndim == 2:
        yield path.name, array
    elif array.ndim == 3:
        yield from ((f"frame {f}", frame) for f, frame in enumerate(array))
    else:
        raise InputError(f"{path}: an array of shape {array.shape}, expected (F, N, 3) with two or more frames")


def _named_frames(path: Path, archive: Archive) -> Iterator[tuple[str, Points]]:
    files = [name for name in archive.files if not is_of_sensors(name)]
    whole = "points" if "points" in files else files[0] if len(files) == 1 else ""
    if whole and len(archive.header(whole).shape) != 2:
        yield from _frames_of_array(path, archive[whole])
        return
    for name in in_order(_frame_names(path, archive, files)):
        yield name, archive[name]


def _frame_names(path: Path, archive: Archive, files: list[str]) -> list[str]:
    """Those of these arrays that are frames, one a frame."""
    groups: dict[str, list[str]] = {}
    for name in files:
        groups.setdefault(re.sub(r"\d+", "0", name), []).append(name)
    for pattern in ("points", "points_0"):
        if pattern in groups:
            return groups[pattern]
    clouds = [names for names in groups.values() if any(_is_cloud(archive.header(name)) for name in names)]
    if len(clouds) > 1:
        listed = ", ".join(names[0] for names in clouds[:6])
        text = "call the frames points_000, points_001, ... or keep only these"
        raise InputError(f"{path}: several kinds of arrays could be the frames ({listed}); {text}")
    return clouds[0] if clouds else files


def _is_cloud(header: ArrayHeader) -> bool:
    return header.dtype.kind in "fiu" and len(header.shape) == 2 and header.shape[1] in COLUMNS
