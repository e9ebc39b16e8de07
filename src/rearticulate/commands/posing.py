"""`pose`: the object of a result in any posture."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from rearticulate.bounds import Finite, conform
from rearticulate.commands.outcome import say
from rearticulate.commands.outputs import check_file
from rearticulate.commands.show import print_json
from rearticulate.errors import InputError
from rearticulate.geometry.se3 import transform
from rearticulate.io.atomic import atomic_file
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.io.palette import part_colors
from rearticulate.io.ply import write_cloud
from rearticulate.io.posture import joint_number, load_posture, named_values, save_posture
from rearticulate.posing.fuse import fuse
from rearticulate.records import FitResult, KinematicModel, Posture

_VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(rad|deg|°|m|cm|mm|%)?")
_TURNS = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def run_pose(
    folder: Path,
    out: Path,
    joints: list[str],
    frame: int | None,
    start: Path | None,
    dense: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """The command `pose`."""
    check_file(out, overwrite)
    if out.suffix.lower() not in (".ply", ".json"):
        raise InputError(f"{out}: a posed cloud is written as .ply, a posture as .json")
    if dense and out.suffix.lower() == ".json":
        raise InputError(f"{out}: a posture has no points, so --dense says nothing")
    result = load_result(folder)
    model = result.model
    posture = set_joints(model, first_posture(result, frame, start), joints)
    if out.suffix.lower() == ".json":
        save_posture(out, model, posture)
    else:
        clouds = fuse(result, load_sequence_of(folder)) if dense else None
        save_posed(out, model, posture, clouds)
    if as_json:
        print_json({"out": str(out), "joints": named_values(model, posture), "T_world_root": posture.T_world_root})
    else:
        print(out)


def first_posture(result: FitResult, frame: int | None, file: Path | None) -> Posture:
    """That of a frame or of a file; else that of the canonical frame."""
    if frame is not None and file is not None:
        raise InputError("give --frame or --from, not both")
    if file is not None:
        return load_posture(file, result.model)
    if frame is None:
        return Posture.rest(result.model)
    F = len(result.motion.q)
    if not 0 <= frame < F:
        raise InputError(f"--frame {frame}: the result has frames 0 to {F - 1}")
    return result.motion.posture(frame)


def set_joints(model: KinematicModel, posture: Posture, settings: list[str]) -> Posture:
    """The posture with some joints set: "part_1=30deg", "part_2=5cm", "part_3=50%" of the observed range."""
    q = posture.q.copy()
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise InputError(f"--joint {setting}: write NAME=VALUE, such as {model.names[-1]}=30deg")
        j = joint_number(model, name.strip(), f"--joint {setting}: ")
        q[model.values(j)] = _joint_value(model, j, setting, text)
        _warn_beyond(model, j, q)
    return Posture(q, posture.T_world_root)


def _joint_value(model: KinematicModel, j: int, setting: str, text: str) -> list[float]:
    kind = model.joint_type[j]
    numbers = text.split(",")
    if kind == "fixed":
        raise InputError(f"--joint {setting}: this joint is fixed")
    if len(numbers) != len(model.values(j)):
        wanted = "three values, X,Y,Z, a rotation vector" if kind == "spherical" else "one value"
        raise InputError(f"--joint {setting}: a {kind} joint takes {wanted}")
    units = _LENGTHS if kind == "prismatic" else _TURNS
    out = []
    for number in numbers:
        match = _VALUE.fullmatch(number.strip())
        unit = (match[2] if match else None) or next(iter(units))
        if match is None or (unit not in units and (unit != "%" or kind == "spherical")):
            known = ", ".join(units) + ("" if kind == "spherical" else ", %")
            raise InputError(f"--joint {setting}: a {kind} joint takes a number with or without one of {known}")
        low, high = model.limits[j]
        value = low + (high - low) * float(match[1]) / 100 if unit == "%" else float(match[1]) * units[unit]
        out.append(conform(f"--joint {setting}: it", float(value), Finite))
    return out


def _warn_beyond(model: KinematicModel, j: int, q: np.ndarray) -> None:
    low, high = model.limits[j]
    value = np.linalg.norm(q[model.values(j)]) if model.joint_type[j] == "spherical" else q[j]
    slack = 0.1 * (high - low) + 1e-9
    if not low - slack <= value <= high + slack:
        unit = "m" if model.joint_type[j] == "prismatic" else "rad"
        say(f"note: {model.names[j]} = {value:.3g} {unit} is beyond what was observed, {low:.3g} to {high:.3g} {unit}")


def save_posed(
    out: Path, model: KinematicModel, posture: Posture, clouds: tuple[np.ndarray, ...] | None = None
) -> None:
    """A coloured PLY of the canonical cloud, or of a cloud a part, in a posture."""
    if clouds is None:
        points, labels = model.points, model.labels
    else:
        points, labels = np.concatenate(clouds), np.repeat(np.arange(len(clouds)), [len(c) for c in clouds])
    posed = transform(model.forward(posture.q, posture.T_world_root)[labels], points)
    with atomic_file(out) as partial:
        write_cloud(partial, posed, part_colors(model.n_parts)[labels])
