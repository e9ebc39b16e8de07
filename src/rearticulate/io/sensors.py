"""Where the sensors stood and which of them took each point: in an `.npz` of frames, or in the `.sensor.npz` beside a
sequence.

origins (F, S, 3): where the sensors of every frame stood, in the coordinates of the points; a row of NaN is none.
sensor_000, sensor_001, ... (N_f,), where known: the row of the sensor that took each point.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError
from rearticulate.io.npz import load_some_arrays
from rearticulate.records import Array, IntArray
from rearticulate.schema import as_array, real, whole

ORIGINS = "origins"
_SENSOR = re.compile(r"sensor_\d+")


@dataclass(frozen=True)
class Sensors:
    """origins: one (S, 3) array a frame. sensor: one (N_f,) array of rows of it a frame, () where unknown."""

    origins: tuple[Array, ...] = ()
    sensor: tuple[IntArray, ...] = ()


def is_of_sensors(name: str) -> bool:
    """Whether an array of an `.npz` says something of the sensors, and is no frame."""
    return name == ORIGINS or _SENSOR.fullmatch(name) is not None


def read_sensors(path: Path, counts: Sequence[int], max_bytes: int) -> Sensors:
    """Those of a sequence whose frames hold so many points. Raises InputError where they do not fit it."""
    own = path.is_file() and path.suffix.lower() == ".npz"
    stem = path.stem if path.is_file() else path.name
    for file in (path,) * own + (path.with_name(f"{stem}.sensor.npz"),):
        arrays = load_some_arrays(file, is_of_sensors, max_bytes) if file.is_file() else {}
        if arrays:
            try:
                return _of_arrays(arrays, counts)
            except InputError as error:
                raise InputError(f"{file}: {error}") from error
    return Sensors()


def _of_arrays(arrays: dict[str, Any], counts: Sequence[int]) -> Sensors:
    if ORIGINS not in arrays:
        raise InputError(f"it names the sensor of points but holds no {ORIGINS}")
    origins = np.asarray(arrays[ORIGINS])
    if origins.dtype.kind not in "fiu" or origins.ndim != 3 or origins.shape[::2] != (len(counts), 3):
        text = f"{origins.dtype} of shape {origins.shape}, expected numbers ({len(counts)}, S, 3)"
        raise InputError(f"{ORIGINS}: {text}")
    there = np.asarray(~np.isnan(origins).all(axis=2))
    names = sorted((name for name in arrays if name != ORIGINS), key=lambda name: int(name.partition("_")[2]))
    if names and len(names) != len(counts):
        raise InputError(f"the sensors of {len(names)} frames, expected {len(counts)}")
    sensor = []
    for row, f, name in zip(there, range(len(counts)), names, strict=False):
        taken = as_array(name, arrays[name], whole("N", 0, below="S"), {"N": counts[f], "S": len(row)})
        if not row[taken].all():
            raise InputError(f"{name}: sensor {int(taken[~row[taken]][0])} has no origin in that frame")
        sensor.append((np.cumsum(row) - 1)[taken])
    found = Sensors(tuple(o[row].astype(np.float64) for o, row in zip(origins, there, strict=True)), tuple(sensor))
    check_sensors(found.origins, found.sensor, counts)
    return found


def check_sensors(origins: Sequence[Array], sensor: Sequence[IntArray], counts: Sequence[int]) -> None:
    """An InputError where sensors do not fit frames of so many points."""
    for what, given in ((ORIGINS, origins), ("sensor", sensor)):
        if len(given) not in (0, len(counts)):
            raise InputError(f"{what}: {len(given)} frames, the sequence has {len(counts)}")
    if sensor and not origins:
        raise InputError(f"it names the sensor of points but holds no {ORIGINS}")
    sizes = [{"N": n} for n in counts]
    for f, of_frame in enumerate(origins):
        as_array(f"{ORIGINS} of frame {f}", of_frame, real("S 3"), sizes[f])
    for f, of_frame in enumerate(sensor):
        as_array(f"sensor of frame {f}", of_frame, whole("N", 0, below="S"), sizes[f])


def sensor_arrays(origins: Sequence[Array], sensor: Sequence[IntArray]) -> dict[str, Array | IntArray]:
    """The arrays of a file that `read_sensors` reads."""
    if not origins:
        return {}
    padded = np.full((len(origins), max(len(of_frame) for of_frame in origins), 3), np.nan)
    for f, of_frame in enumerate(origins):
        padded[f, : len(of_frame)] = of_frame
    return {ORIGINS: padded, **{f"sensor_{f:03d}": of_frame for f, of_frame in enumerate(sensor)}}
