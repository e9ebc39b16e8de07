"""Kinematic trees as flat arrays: `parent` (parents before children, -1 at the root) and one twist a joint.

One formula for every joint type: T_world_part[j] = T_world_part[parent[j]] exp(q_j twist_j) (paper eq. 2 and 3).
"""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.se3 import adjoint, exp_se3


def forward_kinematics(
    parent: Int[Array, " P"],
    twists: Float[Array, "P 6"],
    q: Float[Array, "*batch P"],
    T_world_root: Float[Array, "*#batch 4 4"] | None = None,
) -> Float[Array, "*batch P 4 4"]:
    """Part poses from joint values q and root poses (identity when absent)."""
    return chain(parent, exp_se3(q[..., None] * twists), T_world_root)


def depth_first(parent: Int[Array, " P"]) -> Int[Array, " P"]:
    """The parts, each with all that is below it before the next one."""
    found: list[int] = []
    waiting = [0]
    while waiting:
        found.append(j := waiting.pop())
        waiting += np.flatnonzero(parent == j)[::-1].tolist()
    return np.array(found)


def chain(
    parent: Int[Array, " P"],
    steps: Float[Array, "*batch P 4 4"],
    T_world_root: Float[Array, "*#batch 4 4"] | None = None,
) -> Float[Array, "*batch P 4 4"]:
    """Part poses from the motion of every part against its parent; the root's own step has no effect."""
    T = np.empty_like(steps)
    T[..., 0, :, :] = np.eye(4) if T_world_root is None else T_world_root
    for j in range(1, len(parent)):
        T[..., j, :, :] = T[..., parent[j], :, :] @ steps[..., j, :, :]
    return T


def joint_jacobian(
    parent: Int[Array, " P"], twists: Float[Array, "P 6"], T_world_part: Float[Array, "*batch P 4 4"]
) -> Float[Array, "*batch P 6 P"]:
    """Left twist of part i caused by joint j, d T_i = hat(J[i, :, j]) T_i. Zero column for the root."""
    P = len(parent)
    columns = (adjoint(T_world_part[..., parent[1:], :, :]) @ twists[1:, :, None])[..., 0]  # (..., P-1, 6)
    J = np.zeros((*T_world_part.shape[:-3], P, 6, P))
    for j in range(1, P):
        J[..., j, :, :] = J[..., parent[j], :, :]
        J[..., j, :, j] = columns[..., j - 1, :]
    return J


def screw_jacobian(
    parent: Int[Array, " P"],
    twists: Float[Array, "P 6"],
    q: Float[Array, "*batch P"],
    T_world_part: Float[Array, "*batch P 4 4"],
) -> Float[Array, "*batch P 6 P 6"]:
    """Left twist of part i when joint j's screw is moved by a left twist eta.

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


def subtree(parent: Int[Array, " P"], j: int) -> Int[Array, " n"]:
    """Part j and all parts that hang on it."""
    inside = np.zeros(len(parent), dtype=bool)
    inside[j] = True
    for k in range(j + 1, len(parent)):
        inside[k] = inside[parent[k]]
    return np.flatnonzero(inside)
