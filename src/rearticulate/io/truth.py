"""Ground truth of a sequence, for evaluation only: the `.truth.npz` beside an `.npz`.

labels (F, N), or labels_000, labels_001, ... (N_f,) where frames differ in size: true part of every source point.
poses (F, P, 4, 4): motion of each part from frame 0 to frame f. parents (P,): -1 at the root.
novel (K, P, 4, 4): novel poses from frame 0. edges (E, 2): child, parent (derived, ignored on loading).
Where known: joint_type (P,) of str ("" at the root), joint_axis (P, 3), joint_point (P, 3), both in frame-0
coordinates, joint_state (F, P) rad or m.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError
from rearticulate.io.npz import load_arrays, save_arrays
from rearticulate.io.order import natural_order
from rearticulate.records import GroundTruth

_JOINT_KEYS = ("joint_type", "joint_axis", "joint_point", "joint_state")


def load_truth(path: str | os.PathLike[str]) -> GroundTruth:
    """Read a `.truth.npz`."""
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise InputError(f"{path}: ground truth is an .npz archive")
    arrays = load_arrays(path)
    missing = [key for key in ("poses", "parents") if key not in arrays]
    missing += [] if _label_keys(arrays) else ["labels"]
    if missing:
        raise InputError(f"{path}: no ground truth, it lacks {', '.join(missing)} (it holds {', '.join(arrays)})")
    try:
        return _truth(arrays)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _truth(arrays: dict[str, Any]) -> GroundTruth:
    keys = _label_keys(arrays)
    labels = arrays["labels"] if keys == ["labels"] else [arrays[key] for key in keys]
    novel = arrays.get("novel", np.zeros((0, np.size(arrays["parents"]), 4, 4)))
    if "joint_type" not in arrays:
        return GroundTruth(labels, arrays["poses"], arrays["parents"], novel)
    absent = [key for key in _JOINT_KEYS if key not in arrays]
    if absent:
        raise InputError(f"it has joint_type but no {absent[0]}")
    kinds, axis, point, state = (arrays[key] for key in _JOINT_KEYS)
    if kinds.ndim != 1 or kinds.dtype.kind != "U":
        raise InputError(f"joint_type must be text, one a part, not {kinds.dtype} of shape {kinds.shape}")
    return GroundTruth(labels, arrays["poses"], arrays["parents"], novel, tuple(kinds.tolist()), axis, point, state)


def save_truth(path: str | os.PathLike[str], truth: GroundTruth) -> None:
    """Write a `.truth.npz`, whole or not at all."""
    child = np.flatnonzero(truth.parent >= 0)
    arrays: dict[str, Any] = {
        "poses": truth.poses,
        "novel": truth.novel,
        "parents": truth.parent,
        "edges": np.stack([child, truth.parent[child]], axis=1),
    }
    if len({len(frame) for frame in truth.labels}) == 1:
        arrays["labels"] = np.stack(truth.labels)
    else:
        arrays.update({f"labels_{f:03d}": frame for f, frame in enumerate(truth.labels)})
    if truth.joint_type is not None:
        values = (np.array(truth.joint_type, dtype=np.str_), truth.joint_axis, truth.joint_point, truth.joint_state)
        arrays.update(zip(_JOINT_KEYS, values, strict=True))
    save_arrays(Path(path), arrays, compress=True)


def _label_keys(arrays: dict[str, Any]) -> list[str]:
    """Names of the arrays with labels: one of all frames, or one a frame in order."""
    return ["labels"] if "labels" in arrays else natural_order(k for k in arrays if k.startswith("labels_"))
