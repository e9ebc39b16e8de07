"""Rigid motions in closed form, batched over leading axes.

A twist is (omega, v) in that order; exponential and logarithm as in Lynch & Park, *Modern Robotics*, ch. 3.
One exponential serves revolute, prismatic and general screws: no branch at q = 0 and none at a half turn.
"""

from __future__ import annotations

import numba
import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int

_SMALL = 1e-4  # below this angle the Taylor series is exact to round-off
_RIGID = 1e-5


def hat(w: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """hat(w) @ x = w x x."""
    K = np.zeros((*w.shape[:-1], 3, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -w[..., 2], w[..., 1], -w[..., 0]
    K[..., 1, 0], K[..., 2, 0], K[..., 2, 1] = w[..., 2], -w[..., 1], w[..., 0]
    return K


def _coefficients(
    angle: Float[Array, "*batch"] | float,
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"], Float[Array, "*batch"]]:
    """sin(a)/a, (1 - cos(a))/a^2, (a - sin(a))/a^3 with their limits at 0."""
    small = angle < _SMALL
    a = np.where(small, 1.0, angle)
    a2 = angle * angle
    A = np.where(small, 1 - a2 / 6, np.sin(a) / a)
    B = np.where(small, 0.5 - a2 / 24, (1 - np.cos(a)) / (a * a))
    C = np.where(small, 1 / 6 - a2 / 120, (a - np.sin(a)) / (a * a * a))
    return A, B, C


def exp_se3(twist: Float[Array, "*batch 6"]) -> Float[Array, "*batch 4 4"]:
    """Twist -> transform."""
    twist = np.asarray(twist, dtype=np.float64)
    w, v = twist[..., :3], twist[..., 3:]
    A, B, C = (c[..., None, None] for c in _coefficients(np.linalg.norm(w, axis=-1)))
    K = hat(w)
    K2 = K @ K
    T = np.zeros((*twist.shape[:-1], 4, 4))
    T[..., :3, :3] = np.eye(3) + A * K + B * K2
    T[..., :3, 3] = ((np.eye(3) + B * K + C * K2) @ v[..., None])[..., 0]
    T[..., 3, 3] = 1.0
    return T


def quat_wxyz(R: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 4"]:
    """Rotation -> unit quaternion, scalar first and not negative."""
    R = np.asarray(R, dtype=np.float64)
    trace = np.trace(R, axis1=-2, axis2=-1)
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    # four candidate quaternions, each exact where its own component is the largest (Shepperd 1978)
    q = np.empty((*R.shape[:-2], 4, 4))  # (..., candidate, wxyz)
    anti = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    q[..., 0, 0], q[..., 0, 1:] = 1 + trace, anti
    for i in range(3):
        q[..., i + 1, 0] = anti[..., i]
        for k in range(3):
            q[..., i + 1, k + 1] = (1 - trace + 2 * diagonal[..., i]) if k == i else R[..., i, k] + R[..., k, i]
    best = np.concatenate([trace[..., None], diagonal], -1).argmax(-1)
    quat = np.take_along_axis(q, best[..., None, None], -2)[..., 0, :]
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    return quat * np.where(quat[..., :1] < 0, -1.0, 1.0)


def log_so3(R: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3"]:
    """Rotation -> rotation vector, stable at 0 and at a half turn (through the quaternion)."""
    quat = quat_wxyz(R)
    s = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(s, quat[..., :1])
    return quat[..., 1:] * np.where(s < 1e-12, 2.0, angle / np.maximum(s, 1e-12))


def log_se3(T: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 6"]:
    """Transform -> twist with a rotation angle of at most pi."""
    w = log_so3(T[..., :3, :3])
    angle = np.linalg.norm(w, axis=-1)
    A, B, _ = _coefficients(angle)
    small = angle < _SMALL
    c = np.where(small, 1 / 12, (1 - A / (2 * B)) / np.where(small, 1.0, angle * angle))[..., None, None]
    K = hat(w)
    v = ((np.eye(3) - 0.5 * K + c * (K @ K)) @ T[..., :3, 3:])[..., 0]
    return np.concatenate([w, v], -1)


def inverse(T: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 4 4"]:
    """Inverse of rigid transforms."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -(R_t @ T[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def is_rigid(T: Float[Array, "*batch 4 4"]) -> Bool[Array, "*batch"] | np.bool_:
    """True where transforms are rigid motions, to 1e-5."""
    R = T[..., :3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(axis=(-2, -1))
        right_handed = np.linalg.det(R) > 0
    return (off < _RIGID) & right_handed & (np.abs(T[..., 3, :] - [0, 0, 0, 1]).max(axis=-1) < _RIGID)


def from_unit(T: Float[Array, "*batch 4 4"], unit: float, centre: Float[Array, " 3"]) -> Float[Array, "*batch 4 4"]:
    """Motions of coordinates (x - centre) / unit, as motions of x."""
    out = T.copy()
    out[..., :3, 3] = unit * T[..., :3, 3] + centre - T[..., :3, :3] @ centre
    return out


def to_unit(T: Float[Array, "*batch 4 4"], unit: float, centre: Float[Array, " 3"]) -> Float[Array, "*batch 4 4"]:
    """Motions of x, as motions of coordinates (x - centre) / unit."""
    out = T.copy()
    out[..., :3, 3] = (T[..., :3, 3] + T[..., :3, :3] @ centre - centre) / unit
    return out


def adjoint(T: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 6 6"]:
    """T exp(xi) inv(T) = exp(adjoint(T) xi), order (omega, v)."""
    R = T[..., :3, :3]
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., 3:, :3] = hat(T[..., :3, 3]) @ R
    return out


def transform(T: Float[Array, "*#batch 4 4"], x: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3"]:
    """Apply T (4, 4) or one transform a point (N, 4, 4), with any leading axes, to points (N, 3)."""
    return rotate(T, x) + (T[:3, 3] if T.ndim == 2 else T[..., :3, 3])


def rotate(T: Float[Array, "*#batch 4 4"], n: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3"]:
    """As `transform`, for directions."""
    if T.ndim == 2:
        return n @ T[:3, :3].T
    if T.shape[-3] == 1 and n.ndim > 1:  # one for all points
        return n @ np.swapaxes(T[..., 0, :3, :3], -1, -2)
    return np.einsum("...ij,...j->...i", T[..., :3, :3], n)


@numba.njit(cache=True, nogil=True)
def _each(T, which, x, shift):
    out = np.empty_like(x)
    for i in range(len(x)):
        k = which[i]
        for a in range(3):
            out[i, a] = T[k, a, 0] * x[i, 0] + T[k, a, 1] * x[i, 1] + T[k, a, 2] * x[i, 2] + shift * T[k, a, 3]
    return out


def transform_by(
    T: Float[Array, "*which 4 4"], which: Int[Array, " N"] | tuple[Int[Array, " N"], ...], x: Float[Array, "N 3"]
) -> Float[Array, "N 3"]:
    """Apply T[which] to points."""
    return _by(T, which, x, 1.0)


def rotate_by(
    T: Float[Array, "*which 4 4"], which: Int[Array, " N"] | tuple[Int[Array, " N"], ...], n: Float[Array, "N 3"]
) -> Float[Array, "N 3"]:
    """As `transform_by`, for directions."""
    return _by(T, which, n, 0.0)


def _by(
    T: Float[Array, "*which 4 4"],
    which: Int[Array, " N"] | tuple[Int[Array, " N"], ...],
    x: Float[Array, "N 3"],
    shift: float,
) -> Float[Array, "N 3"]:
    if isinstance(which, tuple):
        which = np.ravel_multi_index(which, T.shape[:-2])
    return _each(np.ascontiguousarray(T).reshape(-1, 4, 4), which, np.ascontiguousarray(x), shift)
