"""Joint axes as lines."""

from __future__ import annotations

import numpy as np

from rearticulate.geometry.se3 import rotate, transform
from rearticulate.records import Array, KinematicModel

AXIS = 0.08  # half the length of a joint's axis, in diagonals of the object


def axis_segments(model: KinematicModel, T_world_part: Array) -> tuple[Array, list[int]]:
    """Both ends of every moving joint's axis (J, 2, 3) under part poses (P, 4, 4), and whose joints they are."""
    joints = [j for j, kind in enumerate(model.joint_type) if kind in ("revolute", "prismatic")]
    half = AXIS * float(np.linalg.norm(np.ptp(model.points, axis=0)))
    segments = np.zeros((len(joints), 2, 3))
    for row, j in enumerate(joints):
        T = T_world_part[model.parent[j]]
        origin, axis = transform(T, model.origin[j]), rotate(T, model.axis[j])
        segments[row] = origin - half * axis, origin + half * axis
    return segments, joints
