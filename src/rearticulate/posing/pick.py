"""Points that a person picks on a posed object, as points of the canonical frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rearticulate.geometry.se3 import inverse, transform
from rearticulate.records import Array, IntArray, KinematicModel, Posture


def pick(
    model: KinematicModel, posture: Posture, points: Array, part: IntArray | None = None
) -> tuple[Array, IntArray]:
    """Points (K, 3) on the object in a posture -> where they are in the canonical frame (K, 3), and their parts (K,).

    part: those that are known, -1 where the nearest is meant; without it the nearest for all.
    """
    posed = replace(model, points=model.pose(posture.q, posture.T_world_root))
    nearest = posed.part_of(points)
    own = nearest if part is None else np.where(part < 0, nearest, part)
    T = model.forward(posture.q, posture.T_world_root)
    return transform(inverse(T[own]), points), own
