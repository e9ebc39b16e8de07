"""Frames that show only a part of the object, by the number of their points.

A part that is not seen gets a wrong pose there, which looks like motion of its own. So the structure comes from the
other frames; these get joint values between those of their neighbours, adjusted to what they do show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rearticulate.arrays import Array, Int
from rearticulate.geometry.se3 import exp_se3, inverse, log_se3
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.bundle import SIGMA, SIGMA_WIDE, bundle_adjust, last_sigma
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import spread_labels

COMPLETE = 0.75  # share of the usual number of points that a complete frame has


def complete_frames(counts: Int[Array, " F"]) -> Int[Array, " n"]:
    """The frames with about as many points as the others; all of them when there are fewer than three."""
    whole = np.flatnonzero(counts >= COMPLETE * np.median(counts))
    return whole if len(whole) >= 3 else np.arange(len(counts))


def between(tree: Articulated, known: Int[Array, " n"], F: int) -> Articulated:
    """Joint values and root poses of all F frames, linear between the known ones (constant beyond them)."""
    place = np.interp(np.arange(F), known, np.arange(len(known)))
    before = np.floor(place).astype(int)
    after = np.minimum(before + 1, len(known) - 1)
    share = place - before
    q = (1 - share)[:, None] * tree.q[before] + share[:, None] * tree.q[after]
    step = log_se3(inverse(tree.T_root[before]) @ tree.T_root[after])
    return replace(tree, q=q, T_root=tree.T_root[before] @ exp_se3(share[:, None] * step))


def fill_in(
    frames: Frames, known: Int[Array, " n"], canonical: int, tree: Articulated, labels: Int[Array, " m"]
) -> tuple[Articulated, Int[Array, " M"]]:
    """The model and the labels of all frames, from those of the known frames. canonical: among all frames."""
    if len(known) == frames.n_frames:
        return tree, labels
    tree = between(tree, known, frames.n_frames)
    seen = np.isin(frames.frame, known)
    everything = np.full(len(frames.points), -1)
    everything[seen] = labels
    for sigma in (SIGMA_WIDE, SIGMA):
        spread = spread_labels(frames, canonical, tree.forward(), everything[frames.rows(canonical)])
        everything = np.where(seen, everything, spread)
        tree, _ = bundle_adjust(frames, canonical, tree, everything, (sigma,))
    fine = last_sigma(frames.noise)
    return bundle_adjust(frames, canonical, tree, everything, (fine,))[0], everything
