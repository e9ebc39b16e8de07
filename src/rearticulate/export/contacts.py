"""Which bodies touch anyway, so that a simulator must not push them apart."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from rearticulate.geometry.se3 import inverse, transform

Array = NDArray[np.floating]


def pairs_in_touch(
    pieces: Mapping[int, Sequence[trimesh.Trimesh]], T: Array, joined: Collection[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Links whose convex pieces, by the number of the link, overlap at any of the poses T (F, L, 4, 4), and those that
    are joined anyway."""
    corners = {j: np.concatenate([piece.vertices for piece in own]) for j, own in pieces.items()}
    planes = {j: [ConvexHull(piece.vertices).equations for piece in own] for j, own in pieces.items()}
    found = []
    for a, b in combinations(pieces, 2):
        T_a_b = inverse(T[:, a]) @ T[:, b]
        near = (a, b) in joined or (b, a) in joined
        if near or _meet(T_a_b, corners[b], planes[a]) or _meet(inverse(T_a_b), corners[a], planes[b]):
            found.append((a, b))
    return found


def _meet(T: Array, points: Array, pieces: Sequence[Array]) -> bool:
    """Whether any point (n, 3), moved by any of T (F, 4, 4), lies in a convex piece, given by its planes (k, 4)."""
    moved = np.concatenate([transform(T_f, points) for T_f in T])
    return any(bool(((moved @ planes[:, :3].T + planes[:, 3]) < 0).all(axis=1).any()) for planes in pieces)
