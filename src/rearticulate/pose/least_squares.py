"""Joint values and root pose that move points onto targets: robust Levenberg-Marquardt, many starts in one batch.

All lengths are shares of the object's size, so one set of constants serves every object and every unit. B starts,
P parts, K point pairs. The energy of one start, with rho(s; sigma) = s / (1 + s / sigma^2) (Geman & McClure 1987):

    sum_k rho(|T[part_k] source_k - target_k|^2; sigma)
    + sum_j (q_j outside its limits / span_j)^2 LIMIT + ((q_j - rest_j) / span_j)^2 PULL
    + rho(3 - trace(R_root) + |t_root|^2; ROOT_SIGMA) ROOT
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rearticulate.geometry.kinematics import forward_kinematics, joint_jacobian
from rearticulate.geometry.se3 import exp_se3, hat, transform
from rearticulate.records import Array, IntArray

LIMIT = 1e-4  # weight of leaving the observed range by one span, size^2
PULL = 1e-6  # weight of being one span from the rest value, size^2
ROOT = 1e-3  # weight of a root that moves by one size or one radian, size^2
ROOT_SIGMA = 0.1  # a root that moves by more than this (of the size, or rad) pays no more: then the data want it
MAX_STEP = 0.7  # longest step of any unknown, rad or sizes
TOLERANCE = 1e-10  # relative decrease of the energy at which a start has converged


@dataclass(frozen=True)
class PoseProblem:
    """What stays the same for all starts, in sizes of the object.

    parent (P,), twists (P, 6), rest (P,), limits (P, 2), span (P,): the tree; source, target: (K, 3).
    path: (P, P) True where joint j moves part i. free_root: whether the root pose is an unknown.
    """

    parent: IntArray
    twists: Array
    limits: Array
    rest: Array
    span: Array
    path: Array
    source: Array
    target: Array
    free_root: bool


@dataclass(frozen=True)
class Starts:
    """B solutions in the making: q (B, P), root (B, 4, 4), part (B, K) of each source point, energy (B,)."""

    q: Array
    root: Array
    part: IntArray
    energy: Array
    converged: Array
    iterations: int = 0

    def take(self, rows: Array) -> Starts:
        return replace(
            self,
            q=self.q[rows],
            root=self.root[rows],
            part=self.part[rows],
            energy=self.energy[rows],
            converged=self.converged[rows],
        )


def start(problem: PoseProblem, q: Array, root: Array, part: IntArray) -> Starts:
    """Starts from guesses; joints that move no source point are set to zero and stay there."""
    used = problem.path[part].any(axis=1)
    B = len(q)
    return Starts(np.where(used, q, 0.0), root.copy(), part, np.full(B, np.inf), np.zeros(B, dtype=bool))


def solve(problem: PoseProblem, starts: Starts, sigma: float, max_iterations: int) -> Starts:
    """Minimise the energy of every start with robust scale sigma (in sizes; inf: plain least squares)."""
    q, root, part = starts.q, starts.root, starts.part
    used = problem.path[part].any(axis=1)
    T, energy = _energy(problem, q, root, part, used, sigma)
    damping = np.full(len(q), 1e-3)
    done = np.zeros(len(q), dtype=bool)
    iterations = 0
    while not done.all() and iterations < max_iterations:
        H, g = _normal_equations(problem, q, root, part, used, T, sigma)
        step = _damped_step(H, g, damping)
        q_new, root_new = _advance(q, root, step)
        T_new, energy_new = _energy(problem, q_new, root_new, part, used, sigma)
        better = (energy_new <= energy) & ~done
        small = energy - energy_new <= TOLERANCE * energy + 1e-16
        done |= (better & small) | (damping > 1e8)
        q, root = np.where(better[:, None], q_new, q), np.where(better[:, None, None], root_new, root)
        T, energy = np.where(better[:, None, None, None], T_new, T), np.where(better, energy_new, energy)
        damping = np.where(better, np.maximum(damping / 8, 1e-12), damping * 6)
        iterations += 1
    return Starts(q, root, part, energy, done, starts.iterations + iterations)


def residuals(problem: PoseProblem, starts: Starts) -> Array:
    """(B, K, 3) source points at the current poses minus their targets."""
    T = forward_kinematics(problem.parent, problem.twists, starts.q, starts.root)
    return _moved(problem, T, starts.part) - problem.target


def _moved(problem: PoseProblem, T: Array, part: IntArray) -> Array:
    return transform(T[np.arange(len(T))[:, None], part], problem.source)


def _energy(
    problem: PoseProblem, q: Array, root: Array, part: IntArray, used: Array, sigma: float
) -> tuple[Array, Array]:
    """Part poses (B, P, 4, 4) and the energy (B,)."""
    T = forward_kinematics(problem.parent, problem.twists, q, root)
    square = ((_moved(problem, T, part) - problem.target) ** 2).sum(axis=-1)
    outside, pull = _joint_offsets(problem, q, used)
    energy = (square / (1 + square / sigma**2)).sum(axis=-1)
    energy += LIMIT * (outside**2).sum(axis=-1) + PULL * (pull**2).sum(axis=-1)
    s = _root_square(root)
    return T, energy + ROOT * s / (1 + s / ROOT_SIGMA**2)


def _joint_offsets(problem: PoseProblem, q: Array, used: Array) -> tuple[Array, Array]:
    """Joint values beyond their limits and away from rest, in spans (B, P); zero for joints that move no source."""
    outside = q - np.clip(q, problem.limits[:, 0], problem.limits[:, 1])
    return used * outside / problem.span, used * (q - problem.rest) / problem.span


def _root_square(root: Array) -> Array:
    """3 - trace(R) + |t|^2, for small motions the squared twist. root: (B, 4, 4). Returns (B,)."""
    return np.maximum(4 - np.trace(root, axis1=-2, axis2=-1), 0.0) + (root[..., :3, 3] ** 2).sum(axis=-1)


def _normal_equations(
    problem: PoseProblem, q: Array, root: Array, part: IntArray, used: Array, T: Array, sigma: float
) -> tuple[Array, Array]:
    """Gauss-Newton matrix (B, P + 6, P + 6) and half gradient (B, P + 6): joints, then the root's left twist."""
    y = _moved(problem, T, part)
    r = y - problem.target
    weight = 1 / (1 + (r**2).sum(axis=-1) / sigma**2) ** 2
    J = point_jacobian(problem, T, part, y)
    B, K, _, D = J.shape
    J_weighted = (J * weight[..., None, None]).reshape(B, 3 * K, D)
    J_t = np.swapaxes(J_weighted, -1, -2)
    H, g = J_t @ J.reshape(B, 3 * K, D), (J_t @ r.reshape(B, 3 * K, 1))[..., 0]
    _add_joint_prior(problem, q, used, H, g)
    if problem.free_root:
        _add_root_prior(root, H, g)
    return H, g


def point_jacobian(problem: PoseProblem, T: Array, part: IntArray, y: Array) -> Array:
    """(B, K, 3, P + 6) change of the moved points y (B, K, 3) with each joint value and the root's left twist."""
    B, K, P = len(T), len(problem.source), len(problem.parent)
    twist = np.zeros((B, K, 6, P + 6))
    twist[..., :P] = joint_jacobian(problem.parent, problem.twists, T)[np.arange(B)[:, None], part]
    if problem.free_root:
        twist[..., P:] = np.eye(6)
    return twist[..., 3:, :] - hat(y) @ twist[..., :3, :]


def _add_joint_prior(problem: PoseProblem, q: Array, used: Array, H: Array, g: Array) -> None:
    outside, pull = _joint_offsets(problem, q, used)
    P = q.shape[-1]
    joints = np.arange(P)
    H[:, joints, joints] += (LIMIT * (outside != 0) + PULL) / problem.span**2
    g[:, :P] += (LIMIT * outside + PULL * pull) / problem.span


def _add_root_prior(root: Array, H: Array, g: Array) -> None:
    P = H.shape[-1] - 6
    weight = ROOT / (1 + _root_square(root) / ROOT_SIGMA**2) ** 2
    t, R = root[..., :3, 3], root[..., :3, :3]
    J = np.zeros((len(root), 3, 6))  # of t
    J[..., :3], J[..., 3:] = -hat(t), np.eye(3)
    J_t = np.swapaxes(J, -1, -2)
    H[:, P:, P:] += weight[:, None, None] * (J_t @ J + np.diag([1.0, 1, 1, 0, 0, 0]))
    turn = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    g[:, P:] += weight[:, None] * (J_t @ t[..., None])[..., 0]
    g[:, P : P + 3] += weight[:, None] * turn / 2


def _damped_step(H: Array, g: Array, damping: Array) -> Array:
    """(B, P + 6) Levenberg-Marquardt step, shortened to MAX_STEP; nothing for unknowns without any curvature."""
    diagonal = np.einsum("bii->bi", H)
    added = damping[:, None] * (diagonal + 1e-6) + 1e-14
    np.einsum("bii->bi", H)[...] += added
    step = -np.linalg.solve(H, g[..., None])[..., 0]
    longest = np.abs(step).max(axis=-1, keepdims=True)
    return step * np.minimum(1.0, MAX_STEP / np.maximum(longest, 1e-300))


def _advance(q: Array, root: Array, step: Array) -> tuple[Array, Array]:
    P = q.shape[-1]
    return q + step[:, :P], exp_se3(step[:, P:]) @ root
