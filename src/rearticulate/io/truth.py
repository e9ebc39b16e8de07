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
from rearticulate.io.readers import natural_order
from rearticulate.records import GroundTruth, IntArray

_JOINT_KEYS = ("joint_type", "joint_axis", "joint_point", "joint_state")


def load_truth(path: str | os.PathLike[str]) -> GroundTruth:
    """Read a `.truth.npz`."""
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise InputError(f"{path}: ground truth is an .npz archive")
    arrays = load_arrays(path)
    missing = [key for key in ("poses", "parents") if key not in arrays]
    labels = _labels(arrays)
    if missing or not labels:
        missing += [] if labels else ["labels"]
        raise InputError(f"{path}: no ground truth, it lacks {', '.join(missing)} (it holds {', '.join(arrays)})")
    parent = arrays["parents"].astype(np.int64)
    novel = arrays.get("novel", np.zeros((0, len(parent), 4, 4)))
    _check(path, arrays, labels, len(parent), novel)
    if "joint_type" not in arrays:
        return GroundTruth(labels, arrays["poses"].astype(np.float64), parent, novel.astype(np.float64))
    kind, axis, point, state = (arrays[key] for key in _JOINT_KEYS)
    return GroundTruth(
        labels=labels,
        poses=arrays["poses"].astype(np.float64),
        parent=parent,
        novel=novel.astype(np.float64),
        joint_type=tuple(str(k) for k in kind),
        joint_axis=axis.astype(np.float64),
        joint_point=point.astype(np.float64),
        joint_state=state.astype(np.float64),
    )


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


def _labels(arrays: dict[str, Any]) -> tuple[IntArray, ...]:
    names = ["labels"] if "labels" in arrays else natural_order(k for k in arrays if k.startswith("labels_"))
    frames = arrays["labels"] if names == ["labels"] else [arrays[name] for name in names]
    return tuple(frame.astype(np.int64) for frame in frames)


def _check(path: Path, arrays: dict[str, Any], labels: tuple[IntArray, ...], P: int, novel: Any) -> None:
    """Shapes that fit together; labels and parents that name parts that exist."""
    F = len(labels)
    expected = {"poses": (F, P, 4, 4), "parents": (P,)}
    if "joint_type" in arrays:
        expected |= {"joint_type": (P,), "joint_axis": (P, 3), "joint_point": (P, 3), "joint_state": (F, P)}
    for key, shape in expected.items():
        if key not in arrays:
            raise InputError(f"{path}: it has joint_type but no {key}")
        if arrays[key].shape != shape:
            raise InputError(f"{path}: {key} has shape {arrays[key].shape}, expected {shape}")
    if novel.shape[1:] != (P, 4, 4):
        raise InputError(f"{path}: novel has shape {novel.shape}, expected (K, {P}, 4, 4)")
    if any(frame.ndim != 1 or not np.isin(frame, np.arange(P)).all() for frame in labels):
        raise InputError(f"{path}: labels must be one part number from 0 to {P - 1} a point")
    if not np.isin(arrays["parents"], np.arange(-1, P)).all():
        raise InputError(f"{path}: parents must be part numbers from 0 to {P - 1}, or -1 at the root")
