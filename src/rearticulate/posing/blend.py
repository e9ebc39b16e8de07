"""Postures between two postures: for animations, and for play between frames."""

from __future__ import annotations

import numpy as np

from rearticulate.geometry.se3 import exp_se3, inverse, log_se3
from rearticulate.records import Array, Motion, Posture


def blend(a: Posture, b: Posture, shares: Array) -> Motion:
    """Postures at shares (S,) of the way from a (0) to b (1): joint values in a straight line, the root along a screw.

    A turn of the root of more than half a circle goes the short way.
    """
    shares = np.asarray(shares, dtype=np.float64)
    screw = log_se3(b.T_world_root @ inverse(a.T_world_root))
    q = a.q + shares[:, None] * (b.q - a.q)
    return Motion(q, exp_se3(shares[:, None] * screw) @ a.T_world_root)


def between_frames(motion: Motion, times: Array) -> Motion:
    """Postures at times (S,) in frames; between two frames blended, before the first and after the last held."""
    times = np.clip(np.asarray(times, dtype=np.float64), 0, len(motion.q) - 1)
    first = np.minimum(times.astype(int), max(len(motion.q) - 2, 0))
    last = np.minimum(first + 1, len(motion.q) - 1)
    steps = [
        blend(motion.posture(f), motion.posture(g), t - f) for f, g, t in zip(first, last, times[:, None], strict=True)
    ]
    return Motion(np.concatenate([s.q for s in steps]), np.concatenate([s.T_world_root for s in steps]))


def eased(count: int) -> Array:
    """(count,) shares from 0 to 1 that start and stop gently."""
    t = np.linspace(0.0, 1.0, count)
    return t * t * (3.0 - 2.0 * t)
