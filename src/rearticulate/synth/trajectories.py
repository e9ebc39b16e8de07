"""Joint and root trajectories of a recording."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.se3 import exp_se3, inverse, transform

Array = NDArray[np.floating]
Start = Literal["random", "middle", "zero"]


def finite_limits(limits: Array) -> Array:
    """Limits (P, 2) in which a joint that turns without end keeps within half a turn of 0."""
    return np.where(np.isfinite(limits), limits, np.array([-np.pi, np.pi]))


def uniform_between(limits: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Random joint values (*shape, P) within limits (P, 2); an unlimited joint stays within half a turn of 0."""
    low, high = finite_limits(limits).T
    return low + rng.random((*shape, len(limits))) * (high - low)


def start_posture(limits: Array, start: Start, rng: np.random.Generator) -> Array:
    """First joint values (P,): random within the limits, in their middle, or the allowed value nearest to zero."""
    low, high = finite_limits(limits).T
    if start == "random":
        return uniform_between(limits, (), rng)
    return (low + high) / 2 if start == "middle" else np.clip(0.0, low, high)


def sweep(q0: Array, limits: Array, step: Array, frames: int, rng: np.random.Generator) -> Array:
    """Joint values (F, P) from q0 (P,): about `step` (P,) a frame (within 20 %), turning round at the limits (P, 2)."""
    direction = np.where(rng.random(len(q0)) < 0.5, -1.0, 1.0)
    steps = direction * step * rng.uniform(0.8, 1.2, (frames - 1, len(q0)))
    return _fold(q0 + np.concatenate([np.zeros((1, len(q0))), np.cumsum(steps, axis=0)]), limits)


def root_walk(frames: int, centre: Array, rng: np.random.Generator, *, step: float, step_deg: float = 5.0) -> Array:
    """Rigid random walk (F, 4, 4) from the identity: each frame turns the object by `step_deg` about its own centre
    (the moved `centre` (3,)) around a random axis, and shifts it by `step` metres in a random direction."""
    T = np.broadcast_to(np.eye(4), (frames, 4, 4)).copy()
    for f in range(1, frames):
        axis, direction = random_directions(2, rng)
        turn = exp_se3(np.concatenate([np.deg2rad(step_deg) * axis, np.zeros(3)]))
        pivot = np.eye(4)
        pivot[:3, 3] = transform(T[f - 1], centre[None])[0]
        T[f] = pivot @ turn @ inverse(pivot) @ T[f - 1]
        T[f, :3, 3] += step * direction
    return T


def random_directions(n: int, rng: np.random.Generator) -> Array:
    """n unit vectors (n, 3), uniform on the sphere."""
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _fold(q: Array, limits: Array) -> Array:
    """Reflect values (F, P) at the limits (P, 2) as often as needed; a joint without limits goes on."""
    low, high = limits.T
    endless = ~np.isfinite(limits).all(axis=1)
    low, width = np.where(endless, 0.0, low), np.where(endless, 1.0, high - low)
    phase = np.mod(q - low, 2 * np.maximum(width, 1e-12))
    return np.where(endless, q, low + np.minimum(phase, np.maximum(2 * width - phase, 0.0)))
