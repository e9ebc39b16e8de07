"""Rigid registration of many bodies at once: point to plane with a share of point to point, Geman-McClure weights.

Every registration in the solver is a weighted least squares problem over left twists (omega, v) of body poses:
minimise sum w ((n . (y - z))^2 + s |y - z|^2) over y <- exp(twist) y. `accumulate` builds its normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import KDTree

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3, rotate_by, transform_by

SETTLED = 3e-3  # a body whose step is smaller, in the second half of the schedule, is done
CONVERGED = 5e-3  # a step that moves less than this many spacings is the last
TWIST_DAMPING = np.array([1e-3] * 3 + [1e-5] * 3)


@dataclass(frozen=True)
class Schedule:
    """Gauss-Newton steps with a robust scale that shrinks geometrically. Lengths in point spacings."""

    iterations: int
    sigma: float
    sigma_end: float
    point_share: float = 0.1
    max_distance: float = np.inf

    def scale(self, i: int) -> float:
        return self.sigma * (self.sigma_end / self.sigma) ** (i / max(self.iterations - 1, 1))


@numba.njit(cache=True, nogil=True)
def accumulate(y, z, normal, w_plane, w_point, body, H, g):
    """Add sum w_plane (n . d)^2 + w_point |d|^2, d = y - z, over left twists to H (B, 6, 6) (upper half), g (B, 6)."""
    J = np.empty(6)
    for i in range(len(y)):
        b = body[i]
        a, p = w_plane[i], w_point[i]
        if a <= 0 and p <= 0:
            continue
        y0, y1, y2 = y[i, 0], y[i, 1], y[i, 2]
        d0, d1, d2 = y0 - z[i, 0], y1 - z[i, 1], y2 - z[i, 2]
        n0, n1, n2 = normal[i, 0], normal[i, 1], normal[i, 2]
        J[0], J[1], J[2] = y1 * n2 - y2 * n1, y2 * n0 - y0 * n2, y0 * n1 - y1 * n0
        J[3], J[4], J[5] = n0, n1, n2
        r = n0 * d0 + n1 * d1 + n2 * d2
        for u in range(6):
            g[b, u] += a * J[u] * r
            for v in range(u, 6):
                H[b, u, v] += a * J[u] * J[v]
        g[b, 0] += p * (y1 * d2 - y2 * d1)
        g[b, 1] += p * (y2 * d0 - y0 * d2)
        g[b, 2] += p * (y0 * d1 - y1 * d0)
        g[b, 3] += p * d0
        g[b, 4] += p * d1
        g[b, 5] += p * d2
        H[b, 0, 0] += p * (y1 * y1 + y2 * y2)
        H[b, 1, 1] += p * (y0 * y0 + y2 * y2)
        H[b, 2, 2] += p * (y0 * y0 + y1 * y1)
        H[b, 0, 1] -= p * y0 * y1
        H[b, 0, 2] -= p * y0 * y2
        H[b, 1, 2] -= p * y1 * y2
        H[b, 0, 4] -= p * y2
        H[b, 0, 5] += p * y1
        H[b, 1, 3] += p * y2
        H[b, 1, 5] -= p * y0
        H[b, 2, 3] -= p * y1
        H[b, 2, 4] += p * y0
        H[b, 3, 3] += p
        H[b, 4, 4] += p
        H[b, 5, 5] += p


def normal_equations(
    y: Float[Array, "n 3"],
    z: Float[Array, "n 3"],
    normal: Float[Array, "n 3"],
    w_plane: Float[Array, " n"],
    w_point: Float[Array, " n"],
    body: Int[Array, " n"],
    n_bodies: int,
) -> tuple[Float[Array, "B 6 6"], Float[Array, "B 6"]]:
    """H symmetric and g of `accumulate`."""
    H, g = np.zeros((n_bodies, 6, 6)), np.zeros((n_bodies, 6))
    accumulate(y, z, normal, w_plane, w_point, body, H, g)
    upper = np.triu(H, 1)
    return H + np.swapaxes(upper, -1, -2), g


def solve_twists(H: Float[Array, "*bodies 6 6"], g: Float[Array, "*bodies 6"]) -> Float[Array, "*bodies 6"]:
    """Damped Gauss-Newton steps."""
    return -np.linalg.solve(H + np.diag(TWIST_DAMPING), g[..., None])[..., 0]


def match(
    tree: KDTree,
    target_normals: Float[Array, "m 3"],
    y: Float[Array, "n 3"],
    ny: Float[Array, "n 3"],
    within: float = np.inf,
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """Nearest target points z, their normals nz, distance d, plane distance r, agreement |cos| of the normals of moved
    points y with normals ny. Beyond `within` d is inf and z any point."""
    d, j = nearest(tree, y, within=within)
    j = np.where(np.isfinite(d), j, 0)
    z, nz = tree.data[j], target_normals[j]
    return z, nz, d, np.einsum("ij,ij->i", y - z, nz), np.abs(np.einsum("ij,ij->i", ny, nz))


def register_bodies(
    tree: KDTree,
    target_normals: Float[Array, "m 3"],
    points: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    body: Int[Array, " n"],
    T: Float[Array, "B 4 4"],
    schedule: Schedule,
) -> Float[Array, "B 4 4"]:
    """Refine T_target_body so that each body's points lie on the target cloud, each on its own."""
    T = T.copy()
    active = np.ones(len(T), dtype=bool)
    for i in range(schedule.iterations):
        rows = np.flatnonzero(active[body])
        sigma, part = schedule.scale(i), body[rows]
        y, ny = transform_by(T, part, points[rows]), rotate_by(T, part, normals[rows])
        z, nz, d, r, agreement = match(tree, target_normals, y, ny, schedule.max_distance)
        found = np.isfinite(d)
        d = np.where(found, d, 0.0)
        w = geman_mcclure(r * r + 0.1 * d * d, sigma) * np.where(agreement > 0.4, agreement, 0.05) * found
        step = solve_twists(*normal_equations(y, z, nz, w, schedule.point_share * w, part, len(T)))
        T[active] = exp_se3(step[active]) @ T[active]
        if 2 * i >= schedule.iterations:
            active &= np.abs(step).max(axis=1) > SETTLED
            if not active.any():
                break
    return T


def fit_cost(
    tree: KDTree, target_normals: Float[Array, "m 3"], y: Float[Array, "n 3"], ny: Float[Array, "n 3"]
) -> Float[Array, " n"]:
    """Misfit of moved points y with normals ny to a cloud: distance, plane distance and normal, each capped."""
    _, _, d, r, agreement = match(tree, target_normals, y, ny)
    c = 1 - agreement
    return np.minimum(d, 2.0) + 0.25 * np.minimum(np.abs(r) / 0.28, 3.0) + 0.2 * np.minimum(c / 0.3, 1.0)
