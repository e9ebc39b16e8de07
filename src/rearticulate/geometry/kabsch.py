"""Rigid motions of matched points: of one group, and of many at once with outliers aside."""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import transform

ROUNDS = 4
RIDGE = 1e-3  # keeps the motion of a group of few points a rotation


def kabsch(source: Float[Array, "K 3"], target: Float[Array, "K 3"]) -> Float[Array, "4 4"]:
    """Rigid motion that brings source closest to target in least squares (Kabsch 1976)."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - b).T @ (source - a))
    T = np.eye(4)
    T[:3, :3] = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    T[:3, 3] = b - T[:3, :3] @ a
    return T


def robust_kabsch(
    source: Float[Array, "n 3"], target: Float[Array, "n 3"], group: Int[Array, " n"], count: int, outlier: float
) -> Float[Array, "count 4 4"]:
    """The motion of each group of points that brings source to target.

    Iteratively reweighted (Geman-McClure) least squares, in closed form each (Kabsch 1976); outlier: the robust scale.
    """
    weight, T = np.ones(len(source)), np.tile(np.eye(4), (count, 1, 1))
    for _ in range(ROUNDS):
        total = np.bincount(group, weight, count)[:, None]
        a, b = (np.stack([np.bincount(group, weight * x, count) for x in z.T], 1) / total for z in (source, target))
        y, x = weight[:, None] * (target - b[group]), source - a[group]
        columns = [np.bincount(group, y[:, r] * x[:, c], count) for r in range(3) for c in range(3)]
        moment = np.stack(columns, axis=1).reshape(-1, 3, 3)
        U, _, Vt = np.linalg.svd(moment + RIDGE * np.eye(3))
        U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
        T[:, :3, :3] = U @ Vt
        T[:, :3, 3] = b - np.einsum("kij,kj->ki", T[:, :3, :3], a)
        error = ((transform(T[group], source) - target) ** 2).sum(axis=1)
        weight = geman_mcclure(error, outlier)
    return T
