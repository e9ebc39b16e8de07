"""Kinematic trees as flat arrays: `parent` (parents before children, -1 at the root) and one twist a joint.

One formula for every joint type: T_world_part[j] = T_world_part[parent[j]] exp(q_j twist_j) (paper eq. 2 and 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.se3 import adjoint, exp_se3

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


def forward_kinematics(parent: IntArray, twists: Array, q: Array, T_world_root: Array | None = None) -> Array:
    """Part poses (..., P, 4, 4) from joint values q (..., P) and root poses (..., 4, 4) (identity when absent)."""
    return chain(parent, exp_se3(q[..., None] * twists), T_world_root)


def depth_first(parent: IntArray) -> IntArray:
    """(P,) the parts, each with all that is below it before the next one."""
    found: list[int] = []
    waiting = [0]
    while waiting:
        found.append(j := waiting.pop())
        waiting += np.flatnonzero(parent == j)[::-1].tolist()
    return np.array(found)


def chain(parent: IntArray, steps: Array, T_world_root: Array | None = None) -> Array:
    """Part poses (..., P, 4, 4) from the motion of every part against its parent, steps (..., P, 4, 4); the root's own
    step has no effect."""
    T = np.empty_like(steps)
    T[..., 0, :, :] = np.eye(4) if T_world_root is None else T_world_root
    for j in range(1, len(parent)):
        T[..., j, :, :] = T[..., parent[j], :, :] @ steps[..., j, :, :]
    return T


def joint_jacobian(parent: IntArray, twists: Array, T_world_part: Array) -> Array:
    """(..., P, 6, P): left twist of part i caused by joint j, d T_i = hat(J[i, :, j]) T_i. Zero column for the root."""
    P = len(parent)
    columns = (adjoint(T_world_part[..., parent[1:], :, :]) @ twists[1:, :, None])[..., 0]  # (..., P-1, 6)
    J = np.zeros((*T_world_part.shape[:-3], P, 6, P))
    for j in range(1, P):
        J[..., j, :, :] = J[..., parent[j], :, :]
        J[..., j, :, j] = columns[..., j - 1, :]
    return J


def screw_jacobian(parent: IntArray, twists: Array, q: Array, T_world_part: Array) -> Array:
    """(..., P, 6, P, 6): left twist of part i when joint j's screw is moved by a left twist eta.

    twist_j -> adjoint(exp(eta)) twist_j changes the step by (I - Ad_step) eta, carried to the world by the parent.
    """
    P = len(parent)
    steps = exp_se3(q[..., 1:, None] * twists[1:])
    blocks = adjoint(T_world_part[..., parent[1:], :, :]) @ (np.eye(6) - adjoint(steps))
    J = np.zeros((*T_world_part.shape[:-3], P, 6, P, 6))
    for j in range(1, P):
        J[..., j, :, :, :] = J[..., parent[j], :, :, :]
        J[..., j, :, j, :] = blocks[..., j - 1, :, :]
    return J


def subtree(parent: IntArray, j: int) -> IntArray:
    """Part j and all parts that hang on it."""
    inside = np.zeros(len(parent), dtype=bool)
    inside[j] = True
    for k in range(j + 1, len(parent)):
        inside[k] = inside[parent[k]]
    return np.flatnonzero(inside)
