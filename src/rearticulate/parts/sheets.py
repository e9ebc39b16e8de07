"""Sheets: do the other frames' points, brought back by a part, form one thin sheet through a point?

This sees errors far below the point spacing, needs good motions, and does not ask whose points they are.
"""

from __future__ import annotations

import numba
import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform_by
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import apart
from rearticulate.observe.planes import draw_pair, first_state

IMPOSSIBLE = 1e3  # evidence against a part that is no candidate
RADIUS = 2.6  # spacings; neighbours within this are tested for a sheet
NEIGHBOURS = 40
TRIES = 20  # planes
THICKNESS = 0.093  # spacings; of points without noise
CURVATURE = 0.008  # thickness grows by this times the squared distance, per spacing
SAMPLING_NOISE = 0.25  # spacings; deviation from a surface that sampling alone may show; what is more is noise


def sheet_thickness(noise: float) -> float:
    """Of points that scatter about their surface by noise; all in spacings."""
    return float(np.sqrt(THICKNESS**2 + max(noise**2 - SAMPLING_NOISE**2, 0.0)))


def part_distances(frames: Frames, labels: Int[Array, " M"], P: int, radius: float) -> Float[Array, "M P"]:
    """Distance to the nearest member of each part in the same frame; inf beyond the radius."""
    out = np.full((len(labels), P), np.inf)
    for f in range(frames.n_frames):
        rows, tree = frames.rows(f), frames.trees[f]
        for p in np.unique(labels[rows]):
            members = tree.data[labels[rows] == p]
            low, high = members.min(axis=0) - radius, members.max(axis=0) + radius
            close = np.flatnonzero(((tree.data > low) & (tree.data < high)).all(axis=1))
            out[frames.start[f] + close, p] = nearest(search_tree(members), tree.data[close], within=radius)[0]
    return out


def doubtful(candidates: Bool[Array, "M P"]) -> Bool[Array, " M"]:
    """Points with more than one candidate."""
    return candidates.sum(axis=1) > 1


@numba.njit(cache=True, nogil=True, fastmath=True)
def _sheet_support(x, y, start, neighbour, thickness, curvature, tries):
    """For every point the largest count of neighbours near a plane through it and two of them.

    A neighbour at w counts 1 - (n . w)^2 / t^2 where that is positive, t = thickness + curvature w^2.
    """
    out = np.zeros(len(x))
    most = np.diff(start).max()
    w, steep = np.empty((3, most)), np.empty(most)
    for i in range(len(x)):
        first, n = start[i], start[i + 1] - start[i]
        if n < 2:
            continue
        for m in range(n):
            j, squared = neighbour[first + m], 0.0
            for c in range(3):
                w[c, m] = y[j, c] - x[i, c]
                squared += w[c, m] * w[c, m]
            steep[m] = 1.0 / (thickness + curvature * squared) ** 2
        state = first_state(i)
        best = 0.0
        for _ in range(tries):
            state, a, b = draw_pair(state, n)
            if a == b:
                continue
            ux, uy, uz = w[0, a], w[1, a], w[2, a]
            vx, vy, vz = w[0, b], w[1, b], w[2, b]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            norm = (nx * nx + ny * ny + nz * nz) ** 0.5
            lengths = ((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz)) ** 0.5
            if norm < 0.35 * lengths or norm < 1e-9:
                continue
            nx, ny, nz = nx / norm, ny / norm, nz / norm
            support = 0.0
            for m in range(n):
                d = nx * w[0, m] + ny * w[1, m] + nz * w[2, m]
                support += max(1.0 - d * d * steep[m], 0.0)
            best = max(best, support)
        out[i] = best
    return out


def sheet_evidence(
    frames: Frames, T: Float[Array, "F P 4 4"], candidates: Bool[Array, "M P"], thickness: float = THICKNESS
) -> Float[Array, "M P"]:
    """Minus the support of the sheet through a point under each candidate part; IMPOSSIBLE elsewhere.

    thickness: of a sheet, in spacings.
    """
    point, part = np.nonzero(candidates)
    z = transform_by(inverse(T), (frames.frame[point], part), frames.points[point])
    keyed = apart(z, part)
    asked = np.flatnonzero((doubtful(candidates)[:, None] & candidates)[point, part])
    out = np.where(candidates, 0.0, IMPOSSIBLE)
    if len(asked) == 0:
        return out
    k = min(NEIGHBOURS, len(z))
    d, j = nearest(search_tree(keyed), keyed[asked], k=k, within=RADIUS)
    frame = frames.frame[point]
    valid = np.isfinite(d)
    valid[valid] = frame[j[valid]] != np.broadcast_to(frame[asked][:, None], j.shape)[valid]
    start = np.concatenate([[0], np.cumsum(valid.sum(axis=1))])
    out[point[asked], part[asked]] = -_sheet_support(z[asked], z, start, j[valid], thickness, CURVATURE, TRIES)
    return out
