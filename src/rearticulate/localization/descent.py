"""One damped Gauss-Newton step of joint values and root pose, for any number of postures at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.kinematics import joint_jacobian
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

DAMP_ROOT = np.array([3.5] * 3 + [1e-2] * 3)
DAMP_HINGE, DAMP_SLIDE = 0.05, 1e-2  # a joint that nothing holds stays
MAX_TURN, MAX_SHIFT = 0.15, 18.0  # in one step, rad and spacings
REACH = 3.0  # robust scales beyond which a point has no counterpart


def pair_weights(r: Array, d: Array, agreement: Array, sigma: float) -> Array:
    """Of pairs of points with plane distance r, distance d, and |cos| between their normals."""
    w = geman_mcclure(r * r + 0.1 * d * d, sigma) * np.where(agreement > 0.4, agreement, 0.05)
    return w * (d < REACH * max(sigma, 1.0))


def stepped(
    parent: IntArray, twists: Array, q: Array, root: Array, T: Array, H: Array, g: Array
) -> tuple[Array, Array]:
    """Joint values (..., P) and root poses (..., 4, 4) after one step from q, root, where the links are at T
    (..., P, 4, 4). H (..., P, 6, 6), g (..., P, 6): normal equations over left twists of the links."""
    to_root = np.broadcast_to(np.eye(6), (*T.shape[:-2], 6, 6))
    J = np.concatenate([joint_jacobian(parent, twists, T), to_root], axis=-1)  # (..., P, 6, P + 6)
    A = (np.swapaxes(J, -1, -2) @ H @ J).sum(axis=-3)
    b = (np.swapaxes(J, -1, -2) @ g[..., None]).sum(axis=-3)
    slides = ~twists[:, :3].any(axis=1)
    damping = np.concatenate([np.where(slides, DAMP_SLIDE, DAMP_HINGE), DAMP_ROOT])
    limit = np.concatenate([np.where(slides, MAX_SHIFT, MAX_TURN), [MAX_TURN] * 3, [MAX_SHIFT] * 3])
    step = np.clip(-np.linalg.solve(A + np.diag(damping), b)[..., 0], -limit, limit)
    return q + step[..., :-6], exp_se3(step[..., -6:]) @ root
