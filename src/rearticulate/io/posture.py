"""Posture files: JSON with the joint values of one posture by the names of the parts, rad and m, and the root's pose.

    {"format": 1, "joints": {"part_1": 0.35, "part_2": -0.02}, "T_world_root": [[1, 0, 0, 0], ...]}

A ball joint has three values, its rotation vector. Joints that are left out stand at 0, as in the canonical frame.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError
from rearticulate.geometry.se3 import is_rigid
from rearticulate.io.atomic import atomic_file
from rearticulate.jsons import json_array, read_json
from rearticulate.records import KinematicModel, Posture
from rearticulate.schema import finite

FORMAT = 1
PathLike = str | os.PathLike[str]


def save_posture(path: PathLike, model: KinematicModel, posture: Posture, **more: Any) -> None:
    """Write a posture; `more` goes into the file beside it and is not read back."""
    for name, values in (("q", posture.q), ("T_world_root", posture.T_world_root)):
        finite(f"{path}: {name}", values)
    record = {"format": FORMAT, "joints": named_values(model, posture), "T_world_root": posture.T_world_root.tolist()}
    with atomic_file(path) as partial:
        partial.write_text(json.dumps({**record, **more}, indent=2) + "\n", encoding="utf-8")


def load_posture(path: PathLike, model: KinematicModel) -> Posture:
    """Read a posture of this model. Raises InputError where the file does not fit it."""
    record = read_json(Path(path))
    joints = record.get("joints") if isinstance(record, dict) else None
    if not isinstance(joints, dict):
        raise InputError(f'{path}: not a posture, it has no "joints"')
    q = np.zeros(model.n_values)
    for name, value in joints.items():
        where = model.values(joint_number(model, name, f"{path}: "))
        q[where] = json_array(value, (len(where),) if len(where) > 1 else (), f"{path}: {name}").reshape(-1)
    root = json_array(record.get("T_world_root", np.eye(4).tolist()), (4, 4), f"{path}: T_world_root")
    if not is_rigid(root):
        raise InputError(f"{path}: T_world_root is not a rigid motion")
    return Posture(q, root)


def named_values(model: KinematicModel, posture: Posture) -> dict[str, float | list[float]]:
    """The values of all joints but the root's, by part."""
    out: dict[str, float | list[float]] = {}
    for j in range(1, model.n_parts):
        values = posture.q[model.values(j)].tolist()
        out[model.names[j]] = values if len(values) > 1 else values[0]
    return out


def joint_number(model: KinematicModel, name: str, where: str = "") -> int:
    """The part whose joint is meant; an InputError lists the names there are."""
    if name not in model.names[1:]:
        known = ", ".join(model.names[1:]) or "none"
        raise InputError(f"{where}no joint is called {name!r}; the joints are {known}")
    return model.names.index(name)
