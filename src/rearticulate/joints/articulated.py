"""The articulated model while it is being fitted: a tree of screws, its joint values and a free root pose a frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.kinematics import forward_kinematics, joint_jacobian, screw_jacobian
from rearticulate.geometry.se3 import adjoint, exp_se3

# Levenberg damping of the directions the data may leave free, in spacings: joint values, root pose, screws.
DAMP_Q, DAMP_ROOT, DAMP_SCREW = 3.5, np.array([3.5] * 3 + [1e-2] * 3), np.array([350.0] * 3 + [1.0] * 3)
MAX_STEP = np.array([0.1] * 3 + [18.0] * 3)


@dataclass(frozen=True)
class Articulated:
    """parent: parents first; twist: zero at the root."""

    parent: Int[Array, " P"]
    twist: Float[Array, "P 6"]
    revolute: Bool[Array, " P"]
    q: Float[Array, "F P"]
    T_root: Float[Array, "F 4 4"]

    @property
    def n_parts(self) -> int:
        return len(self.parent)

    @property
    def axes(self) -> Float[Array, "P 3"]:
        """Unit directions of the joints."""
        return np.where(self.revolute[:, None], self.twist[:, :3], self.twist[:, 3:])

    @property
    def feet(self) -> Float[Array, "P 3"]:
        """Points of the axes nearest to the coordinate origin; 0 for a slide."""
        return np.cross(self.axes, self.twist[:, 3:])

    def forward(self) -> Float[Array, "F P 4 4"]:
        """Part poses."""
        return forward_kinematics(self.parent, self.twist, self.q, self.T_root)


def normalise_twists(twist: Float[Array, "*batch 6"], revolute: Bool[Array, "*batch"]) -> Float[Array, "*batch 6"]:
    """Unit screws without pitch: (axis, origin x axis) or (0, axis)."""
    w, v = twist[..., :3], twist[..., 3:]
    turning = revolute[..., None]
    length = np.linalg.norm(np.where(turning, w, v), axis=-1, keepdims=True)
    scale = 1.0 / np.maximum(length, 1e-12)
    w = np.where(turning, w * scale, 0.0)
    v = v * scale
    v = v - np.where(turning, w * (w * v).sum(-1, keepdims=True), 0.0)
    return np.concatenate([w, v], axis=-1)


def _jacobian(model: Articulated, T: Float[Array, "F P 4 4"]) -> Float[Array, "F P 6 D"]:
    """(F, P, 6, (P - 1) + 6 + 6 (P - 1)): left twists of the parts from joint values, root pose and screws."""
    F, P = T.shape[:2]
    joints = joint_jacobian(model.parent, model.twist, T)[..., 1:]
    root = np.broadcast_to(np.eye(6), (F, P, 6, 6))
    screws = screw_jacobian(model.parent, model.twist, model.q, T)[..., 1:, :].reshape(F, P, 6, 6 * (P - 1))
    return np.concatenate([joints, root, screws], axis=-1)


def reduced_system(
    model: Articulated, canonical: int, H: Float[Array, "F P 6 6"], g: Float[Array, "F P 6"]
) -> tuple[Float[Array, "D D"], Float[Array, " D"], list[int]]:
    """Project part-wise normal equations H, g on the parameters of the tree.

    Unknowns: for each frame but the canonical one (P - 1 joint values, 6 root), then 6 (P - 1) screw twists.
    """
    F, P = H.shape[:2]
    J = _jacobian(model, model.forward())
    own, shared = P - 1 + 6, 6 * (P - 1)
    moving = [f for f in range(F) if f != canonical]
    A, b = np.zeros((len(moving) * own + shared,) * 2), np.zeros(len(moving) * own + shared)
    common = slice(len(moving) * own, None)
    for k, f in enumerate(moving):
        Jf = J[f].reshape(6 * P, -1)
        block = Jf.T @ (H[f] @ J[f]).reshape(6 * P, -1)
        gradient = Jf.T @ g[f].reshape(-1)
        for u, here in ((slice(k * own, (k + 1) * own), slice(own)), (common, slice(own, None))):
            b[u] += gradient[here]
            A[u, k * own : (k + 1) * own] += block[here, :own]
            A[u, common] += block[here, own:]
    return A, b, moving


def gauss_newton_step(
    model: Articulated, canonical: int, H: Float[Array, "F P 6 6"], g: Float[Array, "F P 6"], damping: float = 0.01
) -> Articulated:
    """One damped step of the kinematic bundle adjustment: joint values, root poses and screws together."""
    P = model.n_parts
    A, b, moving = reduced_system(model, canonical, H, g)
    per_joint = np.where(model.revolute[1:], DAMP_Q, 1e-4)
    diagonal = np.concatenate(
        [np.tile(np.concatenate([per_joint, DAMP_ROOT]), len(moving)), np.tile(DAMP_SCREW, P - 1)]
    )
    step = -np.linalg.solve(A + damping * np.diag(diagonal), b)
    return apply_step(model, step, moving)


def apply_step(model: Articulated, step: Float[Array, " D"], moving: list[int]) -> Articulated:
    """Move the parameters by a step in the order of `reduced_system`, each component limited."""
    P = model.n_parts
    own = P - 1 + 6
    frames = step[: len(moving) * own].reshape(len(moving), own)
    q, T_root = model.q.copy(), model.T_root.copy()
    limit = np.where(model.revolute[1:], 0.1, 18.0)
    q[moving, 1:] += np.clip(frames[:, : P - 1], -limit, limit)
    T_root[moving] = exp_se3(np.clip(frames[:, P - 1 :], -MAX_STEP, MAX_STEP)) @ T_root[moving]
    eta = np.clip(step[len(moving) * own :].reshape(P - 1, 6), -MAX_STEP, MAX_STEP)
    twist = model.twist.copy()
    twist[1:] = (adjoint(exp_se3(eta)) @ twist[1:, :, None])[..., 0]
    twist[1:] = normalise_twists(twist[1:], model.revolute[1:])
    return replace(model, q=q, T_root=T_root, twist=twist)
