"""The folder of a result, format 1. No pickles; numbers survive a round trip exactly.

model.json     what a person may want to read:
    format         1; a reader refuses a higher number
    version        of the package that wrote it
    canonical      index of the frame whose cloud defines the rest pose
    parts          in order, parents before children; each with
        name, parent   the parent's name, null at the root
        joint_type     "floating" at the root, else "fixed", "revolute", "prismatic" or "spherical": joint to the parent
        axis, origin   unit axis and a point on it, metres, in the coordinates of the canonical frame
        limits         observed range of the joint value, rad or m
        diagnostics    see `records.JointDiagnostics`
    energy, energies   of the result and of each canonical frame that was tried
    stages         name and seconds of each stage
    seed, config   what to repeat the fit with
    notes          what a reader must know before the numbers, a sentence each
    machine        CPU and linear algebra kernel that it was made on
    Not-a-number and infinities are the strings "nan", "inf" and "-inf"; what was not measured is null.
config.json    the resolved configuration once more, on its own
arrays.npz     points (N, 3) float64 and labels (N,) int64: canonical cloud and its parts; q (F, D);
               T_world_root (F, 4, 4); residual (F,); sampling (F,), if known; frame_labels (sum N_f,): the part of each
               point of the input, frame f in frame_labels[frame_offsets[f]:frame_offsets[f + 1]]; frame_index, split
               alike: row of each of these points in its source file; frame_points (sum N_f, 3), split alike: the points
               themselves
joints.csv     a line a frame: frame, then one column a moving joint, "name [rad]" or "name [m]"; the rotation vector of
               a spherical joint has three, "name.x [rad]" and so on
canonical.ply  the canonical cloud, coloured by part
stages/        what a stopped fit goes on from (see `io.stages`); kept when the result is replaced
"""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.bounds import FAR, shown
from rearticulate.errors import InputError, one_line
from rearticulate.io.atomic import atomic_folder
from rearticulate.io.npz import load_arrays, write_arrays
from rearticulate.io.palette import part_colors
from rearticulate.io.ply import write_cloud
from rearticulate.jsons import json_array, read_json
from rearticulate.records import (
    FitResult,
    IntArray,
    JointDiagnostics,
    KinematicModel,
    Motion,
    PointSequence,
    StageTime,
)
from rearticulate.schema import conform, real, rigid, whole
from rearticulate.version import package_version

FORMAT = 1
_ARRAYS = {
    "points": real("N 3"),
    "labels": whole("N", 0),
    "q": real("F D"),
    "T_world_root": rigid("F 4 4"),
    "residual": real("F", 0),
    "sampling": real("F", 0),  # may be absent
    "frame_labels": whole("M", 0),
    "frame_index": whole("M", 0),
    "frame_points": real("M 3"),
    "frame_offsets": whole("F+1", 0),
}
_UNITS = {"revolute": "rad", "prismatic": "m"}
_MEASURED = ("residual", "axis_std", "origin_std", "runner_up_margin")  # null where not measured
PathLike = str | os.PathLike[str]


def save_result(
    folder: PathLike,
    result: FitResult,
    sequence: PointSequence,
    *,
    overwrite: bool = False,
    extra: Callable[[Path], None] | None = None,
) -> None:
    """Write the folder of a result, whole or not at all (FitError). `extra` may write more files into it.

    overwrite: replace the folder of an earlier result; nothing else is ever replaced (see `check_output`).
    """
    check_output(folder, overwrite=overwrite)
    with atomic_folder(folder, keep="stages") as partial:
        _write_json(partial / "model.json", _describe(result))
        _write_json(partial / "config.json", _plain(result.config))
        write_arrays(partial / "arrays.npz", _arrays(result, sequence), compress=True)
        write_joint_values(partial / "joints.csv", result.model, result.motion)
        model = result.model
        write_cloud(partial / "canonical.ply", model.points, part_colors(model.n_parts)[model.labels])
        if extra is not None:
            extra(partial)


def check_output(folder: PathLike, *, overwrite: bool = False) -> None:
    """An InputError unless a result may be written to `folder`: call it before the work, not after.

    Fine are: no such folder; an empty one; one with nothing but stages/; with `overwrite`, one with a result in it.
    """
    folder = Path(folder)
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: exists and is not a folder")
    try:
        names = {child.name for child in folder.iterdir()}
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}") from error
    if names <= {"stages"}:
        return
    if not names & {"model.json", "stages"}:
        raise InputError(f"{folder}: not empty and not an earlier result, so it is not replaced; name another folder")
    if not overwrite:
        raise InputError(f"{folder}: holds an earlier result; name another folder or ask for it to be overwritten")


def load_result(folder: PathLike) -> FitResult:
    """Read what `save_result` wrote."""
    folder = Path(folder)
    record, arrays = _read(folder)
    with _damage(folder):
        parts = _parts(record)
        return FitResult(
            model=_model(record, parts, arrays),
            motion=Motion(arrays["q"], arrays["T_world_root"]),
            labels=_split(arrays["frame_labels"], arrays["frame_offsets"]),
            joints=tuple(_diagnostics(part["diagnostics"]) for part in parts),
            energy=_number(record["energy"], "energy"),
            energies={int(frame): _number(energy, f"energy {frame}") for frame, energy in record["energies"].items()},
            residual=arrays["residual"],
            stages=tuple(_stage(stage) for stage in record["stages"]),
            config=record["config"],
            seed=record["seed"],
            notes=tuple(record.get("notes", ())),
            machine=record.get("machine", ""),
            sampling=arrays.get("sampling"),
        )


def load_sequence_of(folder: PathLike) -> PointSequence:
    """The sequence that a result was fitted to, as it was fitted."""
    folder = Path(folder)
    _, arrays = _read(folder)
    with _damage(folder):
        points = _split(arrays["frame_points"], arrays["frame_offsets"])
        index = _split(arrays["frame_index"], arrays["frame_offsets"])
        return PointSequence(points, index, tuple(f"frame {f}" for f in range(len(points))))


def load_model(path: PathLike) -> KinematicModel:
    """The model alone, from the folder of a result or from the model.json in it."""
    path = Path(path)
    folder = path.parent if path.name == "model.json" else path
    record, arrays = _read(folder)
    with _damage(folder):
        return _model(record, _parts(record), arrays)


def _describe(result: FitResult) -> dict[str, Any]:
    model = result.model
    parts = [
        {
            "name": model.names[j],
            "parent": None if model.parent[j] < 0 else model.names[model.parent[j]],
            "joint_type": model.joint_type[j],
            "axis": model.axis[j],
            "origin": model.origin[j],
            "limits": model.limits[j],
            "diagnostics": asdict(result.joints[j]),
        }
        for j in range(model.n_parts)
    ]
    record = {
        "format": FORMAT,
        "version": package_version(),
        "canonical": model.canonical,
        "parts": parts,
        "energy": result.energy,
        "energies": result.energies,
        "stages": [asdict(stage) for stage in result.stages],
        "seed": result.seed,
        "config": result.config,
        "notes": list(result.notes),
        "machine": result.machine,
    }
    return _plain(record)


def _plain(value: Any) -> Any:
    """The same value in what JSON has: arrays and tuples as lists, paths as text, non-finite numbers as strings."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _write_json(path: Path, record: Any) -> None:
    path.write_text(json.dumps(record, indent=2, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")


def _arrays(result: FitResult, sequence: PointSequence) -> dict[str, Any]:
    sizes = [len(frame) for frame in result.labels]
    if sizes != [len(frame) for frame in sequence.points]:
        raise ValueError("the result has labels for other frames than those of the sequence")
    return {
        "points": result.model.points,
        "labels": result.model.labels,
        "q": result.motion.q,
        "T_world_root": result.motion.T_world_root,
        "residual": result.residual,
        **({} if result.sampling is None else {"sampling": result.sampling}),
        "frame_labels": np.concatenate(result.labels),
        "frame_index": np.concatenate(sequence.index),
        "frame_points": np.concatenate(sequence.points),
        "frame_offsets": np.cumsum([0, *sizes]),
    }


def write_joint_values(path: Path, model: KinematicModel, motion: Motion) -> None:
    """A CSV with a row a frame and a column a joint value, its unit in the head."""
    columns: dict[str, int] = {}
    for j, kind in enumerate(model.joint_type):
        if kind == "spherical":
            columns |= {f"{model.names[j]}.{x} [rad]": k for x, k in zip("xyz", model.values(j), strict=True)}
        elif kind in _UNITS:
            columns[f"{model.names[j]} [{_UNITS[kind]}]"] = j
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", *columns])
        rows = motion.q[:, list(columns.values())]
        writer.writerows([f, *(repr(float(value)) for value in q)] for f, q in enumerate(rows))


def _read(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """model.json and arrays.npz, of a format that we know."""
    path = folder / "model.json"
    record = read_json(path, absent=f"{folder}: no result here, it has no model.json")
    written = record.get("format") if isinstance(record, dict) else None
    if type(written) is not int or written < 1:
        raise InputError(f"{path}: not a model of rearticulate, it has no format number")
    if written > FORMAT:
        raise InputError(f"{path}: format {written} is newer than this version reads ({FORMAT}); upgrade rearticulate")
    arrays = load_arrays(folder / "arrays.npz")
    with _damage(folder):
        known = _ARRAYS if "sampling" in arrays else {k: v for k, v in _ARRAYS.items() if k != "sampling"}
        return record, conform(arrays, known)


@contextmanager
def _damage(folder: Path) -> Iterator[None]:
    try:
        yield
    except KeyError as error:
        raise InputError(f"{folder}: a damaged result, {error.args[0]!r} is missing") from error
    except (ValueError, TypeError, IndexError, AttributeError) as error:
        raise InputError(f"{folder}: a damaged result ({one_line(error)})") from error


def _parts(record: dict[str, Any]) -> list[dict[str, Any]]:
    parts = record["parts"]
    if not isinstance(parts, list) or not parts or not all(isinstance(part, dict) for part in parts):
        raise InputError("parts must be a list of one object or more")
    return parts


def _model(record: dict[str, Any], parts: list[dict[str, Any]], arrays: dict[str, Any]) -> KinematicModel:
    names = [part["name"] for part in parts]
    for j, part in enumerate(parts):
        if (part["parent"] is None) != (j == 0) or part["parent"] not in [None, *names[:j]]:
            raise InputError(f"the parent of {shown(part['name'])} must be a part before it, none for the first")
    return KinematicModel(
        canonical=record["canonical"],
        parent=np.array([-1 if part["parent"] is None else names.index(part["parent"]) for part in parts]),
        joint_type=tuple(part["joint_type"] for part in parts),
        axis=_numbers(parts, "axis", 3),
        origin=_numbers(parts, "origin", 3),
        limits=_numbers(parts, "limits", 2),
        names=tuple(names),
        points=arrays["points"],
        labels=arrays["labels"],
    )


def _numbers(parts: list[dict[str, Any]], key: str, width: int) -> np.ndarray:
    return np.array([json_array(part[key], (width,), f"{key} of part {j}") for j, part in enumerate(parts)])


def _diagnostics(record: dict[str, Any]) -> JointDiagnostics:
    measured = {key: None if record[key] in (None, "nan") else _number(record[key], key) for key in _MEASURED}
    if not isinstance(record["determined"], bool):
        raise InputError(f"determined must be true or false, not {shown(record['determined'])}")
    for key in ("runner_up", "note"):
        if not isinstance(record[key], str) or not record[key].isprintable():
            raise InputError(f"{key} must be printable text, not {shown(record[key])}")
    return JointDiagnostics(
        **{**record, **measured, "observed_range": _number(record["observed_range"], "observed_range")}
    )


def _stage(record: dict[str, Any]) -> StageTime:
    name, seconds = record["name"], _number(record["seconds"], "seconds")
    if not isinstance(name, str) or not name.isprintable() or not 0 <= seconds < FAR:
        raise InputError(f"a stage has a name and seconds, not {shown(record)}")
    return StageTime(name, seconds)


def _number(value: Any, what: str) -> float:
    """A number as `_plain` writes it."""
    if value in ("nan", "inf", "-inf"):
        return float(value)
    return float(json_array(value, (), what))


def _split(flat: np.ndarray, offsets: IntArray) -> tuple[np.ndarray, ...]:
    if not len(offsets) or offsets[0] != 0 or offsets[-1] != len(flat) or (np.diff(offsets) < 0).any():
        raise InputError("frame_offsets does not fit the arrays of the frames")
    return tuple(np.split(flat, offsets[1:-1]))
