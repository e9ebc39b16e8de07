"""Seams: the border of two parts that turn against each other is a plane across their axis, if the data agree.

On a surface of revolution about the axis both parts explain a point equally well, and the evidence of single points is
noise. One number a joint, the place of the cut, is found from all of them together. A link that was inferred without
points of its own gets them here.
"""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.nearest import contact, nearest, search_tree
from rearticulate.joints.articulated import Articulated
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import to_canonical
from rearticulate.observe.misfit import point_misfit
from rearticulate.parts.sheets import RADIUS, THICKNESS, part_distances, sheet_evidence

ZONE = 9.0  # spacings; points this near to both parts may change sides
MINIMUM_POINTS = 30  # that both parts may have
NEIGHBOURS = 32  # the evidence is averaged over this many points first
SLACK = 1.4  # cuts this close to the best (times the root of the number of points) count as equal
BIN_WIDTH = 0.75  # spacings; of the histogram along the axis that finds the faces of links
PEAK = 2.0  # a face has this many times the usual number of points
DOUBT = 2.7  # a point with more evidence than this against the cut stays where it is
SACRIFICE = 1.15  # evidence a changed point may give up on average, for ten frames
MISFIT = 0.1  # spacings; ... and growth of their misfit to the other frames
MINIMUM_SUPPORT = 5.0  # a link with fewer points a frame may claim points near the gap it bridges ...
LINK_REACH = 12.0  # ... this near, in spacings
CLAIM = 0.25  # cuts that give it up to this share of the sacrifice too much count as equal to the best


def best_cut(along: Float[Array, " n"], favour: Float[Array, " n"], slack: float) -> tuple[float, float]:
    """Place and side (+1: the child is above) of the cut of points at `along` that agrees best with `favour`, the
    evidence for the child over the parent.

    Where cuts within the slack of the best one leave a choice, links end in faces across their axis: the bin with the
    most points is taken if it has PEAK times the usual number, else the middle.
    """
    order = np.argsort(along, kind="stable")
    s, gain = along[order], favour[order]
    above = gain.sum() - np.concatenate([[0.0], np.cumsum(gain)])  # the child has the points from the k-th on
    below = gain.sum() - above
    side = 1.0 if above.max() >= below.max() else -1.0
    score = above if side > 0 else below
    good = np.flatnonzero(score >= score.max() - slack)
    edges = np.concatenate([[s[0] - 1.0], (s[1:] + s[:-1]) / 2, [s[-1] + 1.0]])
    low, high = float(edges[good[0]]), float(edges[good[-1]])
    if high - low > 2 * BIN_WIDTH:
        count, place = np.histogram(s, bins=np.arange(low, high + BIN_WIDTH, BIN_WIDTH))
        if count.max() > PEAK * np.median(count):
            k = int(count.argmax())
            return float((place[k] + place[k + 1]) / 2), side
    return float((low + high) / 2), side


def gap_distances(
    frames: Frames,
    tree: Articulated,
    T: Float[Array, "F P 4 4"],
    labels: Int[Array, " M"],
    z: Float[Array, "M 3"],
    empty: Bool[Array, " P"],
) -> Float[Array, "M P"]:
    """Distance of a point, carried by an empty link's own motion T, from the gap that the link bridges; inf
    where the link has no claim."""
    out = np.full((len(labels), tree.n_parts), np.inf)
    for v in np.flatnonzero(empty):
        above = int(tree.parent[v])
        for below in np.flatnonzero(tree.parent == v):
            za, zb = z[labels == above], z[labels == below]
            if v == 0 or len(za) == 0 or len(zb) == 0:
                continue
            mine = to_canonical(frames, T, np.full(len(labels), v))
            distance = np.linalg.norm(mine - contact(zb, za, 40), axis=1)
            beside = (labels == above) | (labels == below)
            out[beside, v] = np.minimum(out[beside, v], distance[beside])
    return out


def cut_seams(
    frames: Frames,
    tree: Articulated,
    labels: Int[Array, " M"],
    thickness: float = THICKNESS,
    only_empty: bool = False,
) -> Int[Array, " M"]:
    """Labels with the border of every turning joint made a plane where the evidence allows it.

    thickness: of a sheet of points, in spacings. only_empty: only the joints of links that have (almost) no points yet,
    while the motions are still rough.
    """
    empty = np.bincount(labels, minlength=tree.n_parts) / frames.n_frames < MINIMUM_SUPPORT
    turning = tree.revolute & (tree.parent >= 0)
    joints = np.flatnonzero(turning & (empty | empty[tree.parent]) if only_empty else turning)
    if len(joints) == 0:
        return labels
    T = tree.forward()
    z = to_canonical(frames, T, labels)
    candidates = np.isfinite(part_distances(frames, labels, tree.n_parts, ZONE))
    candidates &= np.isin(np.arange(tree.n_parts), np.concatenate([joints, tree.parent[joints]]))
    gap = gap_distances(frames, tree, T, labels, z, empty)
    sheets = candidates | (gap < LINK_REACH + RADIUS)
    U = sheet_evidence(frames, T, sheets, thickness)
    candidates |= gap < LINK_REACH
    labels = labels.copy()
    limit = SACRIFICE * np.sqrt((frames.n_frames - 1) / 9)
    for j in joints:
        p = int(tree.parent[j])
        zone = np.flatnonzero(((labels == j) | (labels == p)) & candidates[:, j] & candidates[:, p])
        if len(zone) < MINIMUM_POINTS:
            continue
        vacant = bool(empty[[j, p]].any())
        slack = CLAIM * limit * len(zone) if vacant else SLACK * np.sqrt(len(zone))
        new = _cut(z[zone], labels[zone], U[zone, p] - U[zone, j], int(j), p, tree.twist[j, :3], limit, slack)
        changed = zone[new != labels[zone]]
        if len(changed) and not vacant:
            other = np.where(labels[changed] == j, p, j)
            worse = point_misfit(frames, T, other, changed) - point_misfit(frames, T, labels[changed], changed)
            if worse.mean() > MISFIT:
                continue
        labels[zone] = new
    return labels


def _cut(
    z: Float[Array, "n 3"],
    labels: Int[Array, " n"],
    favour: Float[Array, " n"],
    j: int,
    p: int,
    axis: Float[Array, " 3"],
    limit: float,
    slack: float,
) -> Int[Array, " n"]:
    """Labels of one border zone, cut if that gives up little evidence. favour: evidence for j over p."""
    near = nearest(search_tree(z), z, k=min(NEIGHBOURS, len(z)))[1]
    favour = favour[near].mean(axis=1)
    along = z @ axis
    mild = np.clip(favour, -DOUBT, DOUBT)
    place, side = best_cut(along, mild, slack)
    new = np.where(side * (along - place) > 0, j, p)
    against = favour * np.where(new == j, -1, 1)  # evidence against the cut, point by point
    changed = new != labels
    if not changed.any() or against[changed].mean() > limit:
        return labels
    return np.where(against > DOUBT, labels, new)
