"""Point sequences from files, checked and cleaned.

A sequence is one of
* an `.npz` with `points` (F, N, 3), or with one (N, 3) array a frame under any names, or an `.npy` (F, N, 3);
* a folder of frames, or a pattern such as "scan/*.ply", one file a frame: .ply, .pcd, .xyz, .txt, .csv, .npy,
  or meshes (.obj, .stl, .off, .glb, .ply with faces), whose surface is sampled.
Frames go by the natural order of their names (frame2 before frame10) and may differ in size.
"""

from __future__ import annotations

import glob
import os
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import Bounds, conform
from rearticulate.errors import InputError, InputWarning
from rearticulate.io.check import check_frame, check_sequence
from rearticulate.io.npz import open_numpy, save_arrays
from rearticulate.io.readers import READERS, Points, check_points, natural_order, read_points
from rearticulate.records import Array, IntArray, PointSequence
from rearticulate.schema import finite

_FAR = 1e30  # sensors mark missing points with huge numbers; no coordinate in any unit is as large
_NOTES = {".txt", ".csv"}  # beside frames of another format these are notes, not frames
_SHAPES = "one (F, N, 3) array called points, or one (N, 3) array a frame"


def load_sequence(
    path: str | os.PathLike[str],
    *,
    scale: float = 1.0,
    max_points: int = 20_000,
    mesh_samples: int = 4096,
    seed: int = 0,
) -> PointSequence:
    """Read a sequence (see the module) and make sure that it can be fitted.

    scale: metres per unit of the file. max_points: larger frames are thinned at random to this size.
    mesh_samples: points drawn from each mesh. seed: of both draws.
    What was dropped is an InputWarning; a sequence that cannot be used is an InputError; each is one line.
    `index` holds the row of each point in its file (for a sampled mesh: in the sample).
    """
    sequence = _read(path, Path(path), scale, max_points, mesh_samples, seed)
    with _named(path):
        check_sequence(sequence)
    return sequence


def load_scans(
    path: str | os.PathLike[str],
    *,
    scale: float = 1.0,
    max_points: int = 20_000,
    mesh_samples: int = 4096,
    seed: int = 0,
) -> PointSequence:
    """As `load_sequence`, for scans of an object whose model is known: one is enough, also as a single file, and each
    is checked by itself alone."""
    file = Path(path)
    single = file.is_file() and file.suffix.lower() in READERS and file.suffix.lower() != ".npy"
    sequence = _read(path, file, scale, max_points, mesh_samples, seed, single)
    with _named(path):
        for name, points in zip(sequence.names, sequence.points, strict=True):
            check_frame(name, points)
    return sequence


@contextmanager
def _named(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read(
    path: str | os.PathLike[str],
    file: Path,
    scale: float,
    max_points: int,
    mesh_samples: int,
    seed: int,
    single: bool = False,
) -> PointSequence:
    """All frames, cleaned. single: the file is one frame."""
    _check_options(scale, max_points, mesh_samples)
    points, index, names, counts = [], [], [], []
    drops: dict[str, list[tuple[str, int]]] = {"broken": [], "double": [], "thinned": []}
    with _system_errors(path):
        for f, (name, raw) in enumerate(_frames([file] if single else file, mesh_samples, seed)):
            kept, row, dropped = _clean(raw, max_points, np.random.default_rng((seed, f, 1)))
            points.append(kept * scale)
            index.append(row)
            names.append(name)
            counts.append(len(raw))
            for kind, count in dropped.items():
                drops[kind] += [(name, count)] if count else []
    _warn(path, drops, max_points)
    return PointSequence(tuple(points), tuple(index), tuple(names), tuple(counts))


def save_sequence(path: str | os.PathLike[str], sequence: PointSequence) -> None:
    """Write an `.npz` of float32 points: `points` (F, N, 3), or points_000, points_001, ... where sizes differ."""
    with np.errstate(over="ignore"):
        frames = [finite(str(path), frame.astype(np.float32)) for frame in sequence.points]
    if len({len(frame) for frame in frames}) == 1:
        save_arrays(Path(path), {"points": np.stack(frames)})
    else:
        save_arrays(Path(path), {f"points_{f:03d}": frame for f, frame in enumerate(frames)})


def _check_options(scale: float, max_points: int, mesh_samples: int) -> None:
    conform("scale", scale, Annotated[float, Bounds(1e-12, 1e12)])
    if min(max_points, mesh_samples) < 1:
        raise InputError(f"max_points ({max_points}) and mesh_samples ({mesh_samples}) must be positive")


@contextmanager
def _system_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: does not fit in memory; give fewer points a frame") from error


def _frames(path: Path | list[Path], mesh_samples: int, seed: int) -> Iterator[tuple[str, Points]]:
    """(name, (N, 3) array as stored) of each frame, one at a time. path: of a sequence, or the files of its frames."""
    if isinstance(path, Path) and path.suffix.lower() in (".npz", ".npy") and path.is_file():
        yield from _frames_of_archive(path)
        return
    for f, file in enumerate(_frame_files(path) if isinstance(path, Path) else path):
        yield file.name, read_points(file, mesh_samples, np.random.default_rng((seed, f, 0)))


def _frames_of_archive(path: Path) -> Iterator[tuple[str, Points]]:
    with open_numpy(path) as content:
        stack = content if path.suffix.lower() == ".npy" else _stack_in(content)
        if stack is None:
            frames = ((name, content[name]) for name in natural_order(content.files))
        else:
            frames = _unstack(path, stack)
        for name, frame in frames:
            yield name, check_points(f"{path}: {name}", frame, _SHAPES)


def _stack_in(archive: Any) -> Points | None:
    """The (F, N, 3) array called `points`, or the only array of the archive; None where frames are single arrays."""
    name = "points" if "points" in archive.files else next(iter(archive.files), "")
    if name == "points" or len(archive.files) == 1:
        points = archive[name]
        return points if points.ndim == 3 else None
    return None


def _unstack(path: Path, points: Points) -> Iterator[tuple[str, Points]]:
    if points.ndim != 3:
        raise InputError(f"{path}: an array of shape {points.shape}, expected (F, N, 3) with two or more frames")
    return ((f"frame {f}", frame) for f, frame in enumerate(points))


def _frame_files(path: Path) -> list[Path]:
    """The frames of a folder or a pattern, in order, all of one format."""
    is_pattern = any(mark in str(path) for mark in "*?[") and not path.exists()
    files = [Path(p) for p in glob.glob(str(path), recursive=True)] if is_pattern else _visible_files(path)
    if not files:
        raise InputError(f"{path}: {'no file matches this pattern' if is_pattern else 'an empty folder'}")
    known = [file for file in files if file.suffix.lower() in (*READERS, ".npz")]
    formats = {file.suffix.lower() for file in known}
    if not is_pattern and formats - _NOTES:
        formats -= _NOTES
    _check_formats(path, files, formats)
    return [Path(p) for p in natural_order(str(file) for file in known if file.suffix.lower() in formats)]


def _visible_files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if not path.is_dir():
        supported = path.suffix.lower() in READERS
        wrong = "one frame only, give the folder of all frames" if supported else _unknown([path])
        raise InputError(f"{path}: {wrong}")
    plain = (file for file in path.iterdir() if not file.name.startswith((".", "_")) and file.is_file())
    return [file for file in plain if file.stem.lower() not in ("readme", "license", "licence")]


def _check_formats(path: Path, files: list[Path], formats: set[str]) -> None:
    if not formats:
        raise InputError(f"{path}: {_unknown(files)}")
    if len(formats) > 1:
        raise InputError(f"{path}: frames of different formats ({', '.join(sorted(formats))}), expected one format")
    if formats == {".npz"}:
        raise InputError(f"{path}: an .npz holds a whole sequence; give one such file, not several")


def _unknown(files: Iterable[Path]) -> str:
    found = ", ".join(sorted({file.suffix or "no extension" for file in files}))
    return f"no known point format ({found}); known are .npz, {', '.join(READERS)}"


def _clean(raw: Points, max_points: int, rng: np.random.Generator) -> tuple[Array, IntArray, dict[str, int]]:
    """Points without broken and double ones, at most max_points of them: (M, 3), their rows (M,), dropped by kind."""
    sound = np.isfinite(raw).all(axis=1) & (np.abs(raw) < _FAR).all(axis=1)
    row = np.flatnonzero(sound)
    points = np.asarray(raw[row], dtype=np.float64) + 0.0  # -0.0 and 0.0 are one number
    first = _first_of_equals(points)
    thinned = max(len(first) - max_points, 0)
    if thinned:
        first = np.sort(rng.choice(first, max_points, replace=False))
    dropped = {"broken": len(raw) - len(row), "double": len(row) - len(first) - thinned, "thinned": thinned}
    return points[first], row[first], dropped


def _first_of_equals(points: Array) -> IntArray:
    """Rows of (N, 3) points that have no equal before them. Sorts one hash a row: ten million take seconds."""
    bits = np.ascontiguousarray(points).view(np.uint64)
    odd: NDArray[np.uint64] = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    hashed = ((bits ^ (bits >> np.uint64(29))) * odd).sum(axis=1)
    order = np.argsort(hashed, kind="stable")
    double = np.zeros(len(points), dtype=bool)
    same = np.flatnonzero(hashed[order[1:]] == hashed[order[:-1]])
    double[order[same + 1]] = (points[order[same + 1]] == points[order[same]]).all(axis=1)
    return np.flatnonzero(~double)


def _warn(path: str | os.PathLike[str], drops: dict[str, list[tuple[str, int]]], max_points: int) -> None:
    texts = {
        "broken": "points with NaN, infinite or absurd coordinates dropped",
        "double": "points that repeat another point dropped",
        "thinned": f"points left out at random to keep {max_points} a frame",
    }
    for kind, frames in drops.items():
        if frames:
            listed = ", ".join(f"{count} in {name}" for name, count in frames[:5])
            more = f", and in {len(frames) - 5} more frames" if len(frames) > 5 else ""
            warnings.warn(f"{path}: {texts[kind]}: {listed}{more}", InputWarning, stacklevel=3)
