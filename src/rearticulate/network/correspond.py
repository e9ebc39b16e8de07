"""Correspondences between clouds: mutual nearest neighbours in feature space that pass a ratio test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.errors import InputError
from rearticulate.network.inference import Network
from rearticulate.network.pyramid import MIN_POINTS, build_pyramid

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


def point_features(net: Network, cloud: Array, scale: float) -> Array:
    """(N, 64) features of a cloud (N, 3), in units of scale, in its own order."""
    if len(cloud) < MIN_POINTS:
        raise InputError(f"the correspondence network needs {MIN_POINTS} points a frame, one has {len(cloud)}")
    pyramid = build_pyramid(cloud, scale)
    return net.features(pyramid)[np.argsort(pyramid.order)]


def mutual_matches(a: Array, b: Array, ratio: float) -> tuple[IntArray, IntArray]:
    """Rows (K,) of a (n, d) and (K,) of b (m, d) that are each other's nearest in feature space, where the distance is
    at most `ratio` times the one to the second nearest."""
    d = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1) - 2 * (a @ b.T)
    best, back = d.argmin(axis=1), d.argmin(axis=0)
    rows = np.arange(len(a))
    nearest = d[rows, best]
    d[rows, best] = np.inf
    sure = nearest <= ratio**2 * d.min(axis=1)
    good = (back[best] == rows) & sure
    return rows[good], best[good]
