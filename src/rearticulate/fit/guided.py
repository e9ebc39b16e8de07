"""Scene flow from the correspondence network, made consistent: matches are sought again near where others lead.

A match by features alone is off by some point spacings, and some are far off. But neighbouring points mostly move like
one rigid body. So the motion of every match is replaced by the robust rigid motion of the matches around it, and each
point is matched again by its features and by how near it is to where that motion takes it, nearer each time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.fit.flow import SceneFlow
from rearticulate.fit.kabsch import robust_kabsch
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.network.correspond import mutual_matches, scores

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

ROUNDS = 12
REACH = (4.0, 0.3)  # spacings; how far from the expected place a match lies, in the first round and in the last
NEIGHBOURS = 48  # matches that say how a match should move
OUTLIER = 3.0  # spacings; their robust scale
CANDIDATES = 24


def matched_flow(a: Array, b: Array, features: tuple[Array, Array], ratio: float) -> SceneFlow:
    """Flow of the mutual matches from cloud a (n, 3) to cloud b (m, 3) with features (n, d), (m, d)."""
    i, j = mutual_matches(*features, ratio)
    return SceneFlow(a[i], b[j] - a[i])


def guided_flow(a: Array, b: Array, features: tuple[Array, Array]) -> SceneFlow:
    """The same, in point spacings, made consistent."""
    score = scores(*features)
    flow = smooth(matched_flow(a, b, features, ratio=1.0))
    for reach in np.geomspace(*REACH, ROUNDS):
        back = SceneFlow(flow.anchors + flow.vectors, -flow.vectors)
        best = _likeliest(a + flow.interpolate(a)[0], b, score, reach)
        home = _likeliest(b + back.interpolate(b)[0], a, score.T, reach)
        rows = np.flatnonzero(home[best] == np.arange(len(a)))
        flow = smooth(SceneFlow(a[rows], b[best[rows]] - a[rows]))
    return flow


def _likeliest(expected: Array, cloud: Array, score: Array, reach: float) -> IntArray:
    """(n,) the row of the cloud (m, 3) for each expected place (n, 3): score (n, m), and Gaussian in the distance."""
    distance, row = nearest(search_tree(cloud), expected, k=min(CANDIDATES, len(cloud)))
    best = (np.take_along_axis(score, row, axis=1) - 0.5 * (distance / reach) ** 2).argmax(axis=1)
    return row[np.arange(len(row)), best]


def smooth(flow: SceneFlow) -> SceneFlow:
    """Every anchor moved by the robust rigid motion of the anchors around it."""
    count = len(flow.anchors)
    k = min(NEIGHBOURS, count)
    if k < 3:
        return flow
    around = nearest(search_tree(flow.anchors), flow.anchors, k=k)[1].ravel()
    source, group = flow.anchors[around], np.repeat(np.arange(count), k)
    T = robust_kabsch(source, source + flow.vectors[around], group, count, OUTLIER)
    return SceneFlow(flow.anchors, transform(T, flow.anchors) - flow.anchors)
