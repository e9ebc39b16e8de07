"""Point sequences from files, checked and cleaned.

A sequence is one of
* an `.npz` or `.npy` (see `io.arrays`): `points` (F, N, 3), or one (N, 3) array a frame;
* a folder of frames, or a pattern such as "scan/*.ply", one file a frame: .ply, .pcd, .xyz, .txt, .csv, .npy,
  or meshes (.obj, .stl, .off, .glb, .ply with faces), whose surface is sampled (see `io.folder`).
Frames go by the numbers or times in their names (see `io.order`) and may differ in size. Where the sensors stood may be
told beside them (see `io.sensors`). A file must hold what its
header promises, no more and no less, within a budget of bytes (see `io.budget`).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rearticulate.errors import InputError, InputWarning, printable
from rearticulate.io.arrays import SHAPES, frames_in_arrays
from rearticulate.io.budget import MAX_BYTES
from rearticulate.io.check import check_frame, check_sequence
from rearticulate.io.clean import Cleaned, clean
from rearticulate.io.folder import frame_files
from rearticulate.io.measure import warn_of_steps
from rearticulate.io.npz import save_arrays
from rearticulate.io.readers import READERS, Points, Reading, check_points, read_points
from rearticulate.io.sensors import Sensors, read_sensors, sensor_arrays
from rearticulate.records import PointSequence
from rearticulate.schema import finite


@dataclass(frozen=True)
class _Options:
    """Of a reading; see `load_sequence`."""

    scale: float
    max_points: int
    max_bytes: int
    mesh_samples: int
    seed: int

    def check(self) -> None:
        if not 1e-12 <= self.scale <= 1e12:
            raise InputError(f"scale must be a positive number of metres a unit (1e-12 to 1e12), not {self.scale}")
        counts = {"max_points": self.max_points, "mesh_samples": self.mesh_samples, "max_bytes": self.max_bytes}
        if min(counts.values()) < 1:
            raise InputError(" and ".join(f"{name} ({n})" for name, n in counts.items()) + " must be positive")

    def reading(self, f: int, told: _Told) -> Reading:
        """Of frame f."""
        return Reading(self.mesh_samples, np.random.default_rng((self.seed, f, 0)), self.max_bytes, told.note)


def load_sequence(
    path: str | os.PathLike[str],
    *,
    scale: float = 1.0,
    max_points: int = 20_000,
    mesh_samples: int = 4096,
    seed: int = 0,
    max_bytes: int = MAX_BYTES,
) -> PointSequence:
    """Read a sequence (see the module) and make sure that it can be fitted.

    scale: metres per unit of the file. max_points: larger frames are thinned at random to this size.
    mesh_samples: points drawn from each mesh. seed: of both draws. max_bytes: that one file may take, unpacked.
    What was dropped is an InputWarning; a sequence that cannot be used is an InputError; each is one line.
    `index` holds the row of each point in its file (for a sampled mesh: in the sample).
    """
    sequence = _read(path, _Options(scale, max_points, max_bytes, mesh_samples, seed))
    with _named(path):
        check_sequence(sequence)
    warn_of_steps(sequence)
    return sequence


def load_scans(
    path: str | os.PathLike[str],
    *,
    scale: float = 1.0,
    max_points: int = 20_000,
    mesh_samples: int = 4096,
    seed: int = 0,
    max_bytes: int = MAX_BYTES,
) -> PointSequence:
    """As `load_sequence`, for scans of an object whose model is known: one is enough, also as a single file, and each
    is checked by itself alone."""
    sequence = _read(path, _Options(scale, max_points, max_bytes, mesh_samples, seed), single=True)
    with _named(path):
        for name, points in zip(sequence.names, sequence.points, strict=True):
            check_frame(name, points)
    return sequence


def save_sequence(path: str | os.PathLike[str], sequence: PointSequence) -> None:
    """Write an `.npz` of float32 points: `points` (F, N, 3), or points_000, points_001, ... where sizes differ. With
    what is known of the sensors."""
    with np.errstate(over="ignore"):
        frames = [finite(str(path), frame.astype(np.float32)) for frame in sequence.points]
    sensors = sensor_arrays(sequence.origins, sequence.sensor)
    if len({len(frame) for frame in frames}) == 1:
        save_arrays(Path(path), {"points": np.stack(frames), **sensors})
    else:
        save_arrays(Path(path), {f"points_{f:03d}": frame for f, frame in enumerate(frames)} | sensors)


@contextmanager
def _named(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read(path: str | os.PathLike[str], options: _Options, single: bool = False) -> PointSequence:
    """All frames, cleaned. single: a file of one frame will do."""
    options.check()
    told = _Told()
    frames: list[Cleaned] = []
    names, counts, at_origin = [], [], False
    with _system_errors(path):
        for f, (name, raw) in enumerate(_frames(Path(path), options, told, single)):
            frame, missing = clean(raw, options.max_points, np.random.default_rng((options.seed, f, 1)))
            frames.append(frame)
            names.append(name)
            counts.append(len(raw))
            at_origin |= missing
    if at_origin:
        frames = [frame.without_origin() for frame in frames]
    for name, frame in zip(names, frames, strict=True):
        told.frame = name
        for what, count in frame.dropped.items():
            told.note(what.format(max_points=options.max_points), count)
    told.warn(path)
    points = tuple(frame.points * options.scale for frame in frames)
    with _system_errors(path):
        sensors = Sensors() if single else read_sensors(Path(path), counts, options.max_bytes)
    origins = tuple(origin * options.scale for origin in sensors.origins)
    sensor = tuple(taken[frame.rows] for taken, frame in zip(sensors.sensor, frames, strict=False))
    return PointSequence(points, tuple(frame.rows for frame in frames), tuple(names), tuple(counts), origins, sensor)


@contextmanager
def _system_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: does not fit in memory; give fewer points a frame") from error


def _frames(path: Path, options: _Options, told: _Told, single: bool) -> Iterator[tuple[str, Points]]:
    """(name, (N, 3) array as stored) of each frame, one at a time."""
    kind, is_file = path.suffix.lower(), path.is_file()
    if is_file and kind in (".npz", ".npy"):
        for name, frame in frames_in_arrays(path, options.max_bytes):
            told.frame = name
            yield name, check_points(f"{path}: {name}", frame, SHAPES, told.note)
        return
    files = [(path.name, path)] if single and is_file and kind in READERS else frame_files(path)
    for f, (name, file) in enumerate(files):
        told.frame = printable(name)
        yield told.frame, read_points(file, options.reading(f, told))


@dataclass
class _Told:
    """What is to be said of the frames: one InputWarning a kind, however many frames it concerns."""

    frame: str = ""
    kinds: dict[str, list[tuple[str, int]]] = field(default_factory=dict)

    def note(self, what: str, count: int) -> None:
        """`count` points of the present frame."""
        if count:
            self.kinds.setdefault(what, []).append((self.frame, count))

    def warn(self, path: str | os.PathLike[str]) -> None:
        for what, frames in self.kinds.items():
            listed = ", ".join(f"{count} in {name}" for name, count in frames[:5])
            more = f", and in {len(frames) - 5} more frames" if len(frames) > 5 else ""
            warnings.warn(f"{path}: {what}: {listed}{more}", InputWarning, stacklevel=4)
