"""Joint values and root pose that move points onto targets: robust Levenberg-Marquardt, many starts in one batch.

All lengths are shares of the object's size, so one set of constants serves every object and every unit. B starts,
P parts, K point pairs. The energy of one start, with rho(s; sigma) = s / (1 + s / sigma^2) (Geman & McClure 1987):

    sum_k rho(|T[part_k] source_k - target_k|^2; sigma)
    + sum_j (q_j outside its limits / span_j)^2 LIMIT + ((q_j - rest_j) / span_j)^2 PULL
    + rho(3 - trace(R_root) + |t_root|^2; ROOT_SIGMA) ROOT
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.kinematics import forward_kinematics, joint_jacobian
from rearticulate.geometry.se3 import exp_se3, hat, transform
from rearticulate.records import Array, IntArray

BoolArray = NDArray[np.bool_]

LIMIT = 1e-6  # weight of leaving the observed range by one span, size^2
PULL = 1e-6  # weight of being one span from the rest value, size^2
ROOT = 1e-2  # weight of a root that moves by one size or one radian, size^2
ROOT_SIGMA = 0.1  # a root that moves by more than this (of the size, or rad) pays no more: then the data want it
MAX_STEP = 0.7  # longest step of any unknown, rad or sizes
TOLERANCE = 1e-10  # relative decrease of the energy at which a start has converged


@dataclass(frozen=True)
class PoseProblem:
    """What stays the same for all starts, in sizes of the object.

    parent (P,), twists (P, 6), rest (P,), limits (P, 2), span (P,): the tree; held (P,): values of joints that move no
    source point; source, target: (K, 3).
    path: (P, P) True where joint j moves part i. free_root: whether the root pose is an unknown.
    """

    parent: IntArray
    twists: Array
    limits: Array
    rest: Array
    held: Array
    span: Array
    path: BoolArray
    source: Array
    target: Array
    free_root: bool


@dataclass(frozen=True)
class Starts:
    """B solutions in the making.

    q (B, P), root (B, 4, 4), part (B, K) of each source point, energy (B,), converged (B,); iterations of the batch.
    """

    q: Array
    root: Array
    part: IntArray
    energy: Array
    converged: BoolArray
    iterations: int = 0

    def best(self, count: int) -> Starts:
        """The `count` starts of least energy, best first."""
        rows = np.argsort(self.energy, kind="stable")[:count]
        return Starts(
            self.q[rows], self.root[rows], self.part[rows], self.energy[rows], self.converged[rows], self.iterations
        )


def start(problem: PoseProblem, q: Array, root: Array, part: IntArray) -> Starts:
    """Starts from guesses; joints that move no source point are held where they are."""
    used = problem.path[part].any(axis=1)
    return Starts(np.where(used, q, problem.held), root, part, np.full(len(q), np.inf), np.zeros(len(q), dtype=bool))


def solve(problem: PoseProblem, starts: Starts, sigma: float, max_iterations: int) -> Starts:
    """Minimise the energy of every start with robust scale sigma (in sizes; inf: plain least squares)."""
    descent = _Descent(problem, starts.part, sigma)
    q, root = starts.q, starts.root
    T, energy = descent.energy(q, root)
    damping, done = np.full(len(q), 1e-3), np.zeros(len(q), dtype=bool)
    iterations = 0
    while not done.all() and iterations < max_iterations:
        step = _damped_step(*descent.normal_equations(q, root, T), damping)
        q_new, root_new = q + step[:, :-6], exp_se3(step[:, -6:]) @ root
        T_new, energy_new = descent.energy(q_new, root_new)
        better = (energy_new <= energy) & ~done
        done |= (better & (energy - energy_new <= TOLERANCE * energy + 1e-16)) | (damping > 1e8)
        q, root = np.where(better[:, None], q_new, q), np.where(better[:, None, None], root_new, root)
        T, energy = np.where(better[:, None, None, None], T_new, T), np.where(better, energy_new, energy)
        damping = np.where(better, np.maximum(damping / 8, 1e-12), damping * 6)
        iterations += 1
    return Starts(q, root, starts.part, energy, done, starts.iterations + iterations)


def residuals(problem: PoseProblem, starts: Starts) -> Array:
    """(B, K, 3) source points at the current poses minus their targets."""
    T = forward_kinematics(problem.parent, problem.twists, starts.q, starts.root)
    return moved(problem, T, starts.part) - problem.target


def moved(problem: PoseProblem, T: Array, part: IntArray) -> Array:
    """(B, K, 3) source points carried by their parts (B, K) with poses T (B, P, 4, 4)."""
    return transform(T[np.arange(len(T))[:, None], part], problem.source)


def point_jacobian(problem: PoseProblem, T: Array, part: IntArray) -> Array:
    """(B, K, 3, P + 6) change of the moved points with each joint value and with a left twist of the root."""
    B, K, P = len(T), len(problem.source), len(problem.parent)
    twist = np.zeros((B, K, 6, P + 6))
    twist[..., :P] = joint_jacobian(problem.parent, problem.twists, T)[np.arange(B)[:, None], part]
    if problem.free_root:
        twist[..., P:] = np.eye(6)
    return twist[..., 3:, :] - hat(moved(problem, T, part)) @ twist[..., :3, :]


class _Descent:
    """The energy of a batch of starts and its Gauss-Newton model, for fixed labels and one robust scale."""

    def __init__(self, problem: PoseProblem, part: IntArray, sigma: float) -> None:
        self.problem, self.part, self.sigma = problem, part, sigma
        self.used = problem.path[part].any(axis=1)  # (B, P) joints that move a source point

    def energy(self, q: Array, root: Array) -> tuple[Array, Array]:
        """Part poses (B, P, 4, 4) and the energy (B,)."""
        T = forward_kinematics(self.problem.parent, self.problem.twists, q, root)
        square = ((moved(self.problem, T, self.part) - self.problem.target) ** 2).sum(axis=-1)
        outside, pull = self._joint_offsets(q)
        points = (square / (1 + square / self.sigma**2)).sum(axis=-1)
        joints = LIMIT * (outside**2).sum(axis=-1) + PULL * (pull**2).sum(axis=-1)
        s = _root_square(root)
        return T, points + joints + ROOT * s / (1 + s / ROOT_SIGMA**2)

    def normal_equations(self, q: Array, root: Array, T: Array) -> tuple[Array, Array]:
        """Gauss-Newton matrix (B, P + 6, P + 6) and half gradient (B, P + 6): joints, then the root's left twist."""
        r = moved(self.problem, T, self.part) - self.problem.target
        weight = 1 / (1 + (r**2).sum(axis=-1) / self.sigma**2) ** 2
        J = point_jacobian(self.problem, T, self.part)
        B, K, _, D = J.shape
        J_t = np.swapaxes((J * weight[..., None, None]).reshape(B, 3 * K, D), -1, -2)
        H, g = J_t @ J.reshape(B, 3 * K, D), (J_t @ r.reshape(B, 3 * K, 1))[..., 0]
        self._add_joint_prior(q, H, g)
        if self.problem.free_root:
            _add_root_prior(root, H, g)
        return H, g

    def _joint_offsets(self, q: Array) -> tuple[Array, Array]:
        """Joint values beyond their limits and away from rest, in spans (B, P); zero for joints not in use."""
        limits, span = self.problem.limits, self.problem.span
        outside = q - np.clip(q, limits[:, 0], limits[:, 1])
        return self.used * outside / span, self.used * (q - self.problem.rest) / span

    def _add_joint_prior(self, q: Array, H: Array, g: Array) -> None:
        outside, pull = self._joint_offsets(q)
        P, span = q.shape[-1], self.problem.span
        diagonal = np.arange(P)
        H[:, diagonal, diagonal] += (LIMIT * (outside != 0) + PULL) / span**2
        g[:, :P] += (LIMIT * outside + PULL * pull) / span


def _root_square(root: Array) -> Array:
    """3 - trace(R) + |t|^2, for small motions the squared length of the twist. root: (B, 4, 4). Returns (B,)."""
    return np.maximum(4 - np.trace(root, axis1=-2, axis2=-1), 0.0) + (root[..., :3, 3] ** 2).sum(axis=-1)


def _add_root_prior(root: Array, H: Array, g: Array) -> None:
    weight = ROOT / (1 + _root_square(root) / ROOT_SIGMA**2) ** 2
    t, R = root[..., :3, 3], root[..., :3, :3]
    J = np.concatenate([-hat(t), np.tile(np.eye(3), (len(root), 1, 1))], axis=-1)  # of t, (B, 3, 6)
    J_t = np.swapaxes(J, -1, -2)
    turn = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    H[:, -6:, -6:] += weight[:, None, None] * (J_t @ J + np.diag([1.0, 1, 1, 0, 0, 0]))
    g[:, -6:] += weight[:, None] * (J_t @ t[..., None])[..., 0]
    g[:, -6:-3] += weight[:, None] * turn / 2


def _damped_step(H: Array, g: Array, damping: Array) -> Array:
    """(B, P + 6) Levenberg-Marquardt step, shortened to MAX_STEP; nothing for unknowns without any curvature."""
    diagonal = np.einsum("bii->bi", H)
    diagonal += damping[:, None] * (diagonal + 1e-6) + 1e-14
    step = -np.linalg.solve(H, g[..., None])[..., 0]
    longest = np.abs(step).max(axis=-1, keepdims=True)
    return step * np.minimum(1.0, MAX_STEP / np.maximum(longest, 1e-300))
