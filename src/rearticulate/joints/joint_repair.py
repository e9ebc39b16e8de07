"""Lost frames, repaired in joint space: a branch of the tree is started again from other joint values.

Each branch of the root is tried with the values of the frame before, extrapolated, interpolated and its own; a part
that fits badly is swept through a grid of its joint (one dimension, so the search is exhaustive), root to leaf.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.kinematics import forward_kinematics, joint_jacobian, subtree
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import rotate, rotate_by, transform, transform_by
from rearticulate.joints.articulated import Articulated
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import Schedule, fit_cost, match, normal_equations
from rearticulate.parts.repair import (
    BACKWARD_WEIGHT,
    MAX_UNEXPLAINED,
    MINIMUM_POINTS,
    REACH,
    SUBSET,
    SUSPICION,
    UNEXPLAINED,
    outwards,
)
from rearticulate.parts.trial import flatten, mean_by
from rearticulate.progress import Told, untold

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

JOINT_SCHEDULE = Schedule(iterations=12, sigma=3.7, sigma_end=0.56)
BRANCH_SUSPICION = 1.08  # a misfit above this times the branch's best one calls for a restart
BRANCH_POINTS = 400  # points of a branch of the tree in a joint-space restart
MARGIN = 0.015  # spacings; other joint values must lower the misfit by this much to be taken
SWEEP_DEG = 60.0  # a joint is searched this far either way
SWEEP_STEP_DEG = 6.0


@dataclass(frozen=True)
class Branch:
    """Joint `top` and the parts that hang on it, with a sample of their canonical points."""

    top: int
    parts: IntArray
    points: IntArray


class JointRepairer:
    def __init__(
        self,
        frames: Frames,
        canonical: int,
        model: Articulated,
        labels: IntArray,
        rng: np.random.Generator,
    ):
        rows = frames.rows(canonical)
        self.frames, self.canonical, self.model, self.rng = frames, canonical, model, rng
        self.x, self.nx, self.labels = frames.points[rows], frames.normals[rows], labels[rows]
        self.q = model.q.copy()
        self.best: dict[int, float] = {}

    def branch(self, top: int) -> Branch | None:
        """The branch of joint `top`; None when it has too few points to tell."""
        parts = subtree(self.model.parent, top)
        share = max(25, BRANCH_POINTS // len(parts))
        chosen = []
        for p in parts:
            rows = np.flatnonzero(self.labels == p)
            chosen.append(rows if len(rows) <= share else self.rng.choice(rows, share, replace=False))
        points = np.concatenate(chosen)
        return Branch(top, parts, points) if len(points) >= MINIMUM_POINTS else None

    def _forward(self, f: int, q: Array) -> Array:
        """(C, P, 4, 4) part poses in frame f for configurations q (C, P)."""
        return forward_kinematics(self.model.parent, self.model.twist, q, self.model.T_root[f])

    def cost(self, f: int, q: Array, sets: list[IntArray]) -> Array:
        """(C,) mean misfit of each configuration's points."""
        point, config = flatten(sets)
        T = self._forward(f, q)[config, self.labels[point]]
        normals = self.frames.normals[self.frames.rows(f)]
        cost = fit_cost(self.frames.trees[f], normals, transform(T, self.x[point]), rotate(T, self.nx[point]))
        return mean_by(config, cost, len(q))

    def missing(self, f: int, q: Array, parts: list[IntArray]) -> Array:
        """(C,) unexplained points of frame f: capped distance to the parts beyond what the other parts explain."""
        now = transform(self._forward(f, self.q[f])[self.labels], self.x)
        poses = self._forward(f, q)
        out = np.zeros(len(q))
        lonely: dict[bytes, tuple[IntArray, Array]] = {}
        for c, members in enumerate(parts):
            key = members.tobytes()
            if key not in lonely:
                mine = np.flatnonzero(np.isin(self.labels, members))
                lonely[key] = mine, self._unexplained(f, np.delete(now, mine, axis=0)) if len(mine) else now[:0]
            mine, u = lonely[key]
            if len(u):
                moved = transform(poses[c, self.labels[mine]], self.x[mine])
                d = nearest(search_tree(moved), u, within=REACH)[0]
                out[c] = np.minimum(d, REACH).sum() * BACKWARD_WEIGHT / max(len(mine), 20)
        return out

    def _unexplained(self, f: int, others: Array) -> Array:
        """Points of frame f that the other parts' points (n, 3) do not reach; a sample when there are many."""
        target = self.frames.trees[f].data
        if len(others) == 0:
            return target[:0]
        far = nearest(search_tree(others), target, within=UNEXPLAINED)[0] > UNEXPLAINED
        u = target[far]
        return u[:: max(1, len(u) // MAX_UNEXPLAINED)]

    def refine(self, f: int, q: Array, branches: list[Branch]) -> Array:
        """Gauss-Newton over the joints of each configuration's branch; q (C, P)."""
        q, (C, P) = q.copy(), q.shape
        point, config = flatten([b.points for b in branches])
        free = np.zeros((C, P))
        for c, b in enumerate(branches):
            free[c, b.parts] = 1.0
        label = self.labels[point]
        tree, normals = self.frames.trees[f], self.frames.normals[self.frames.rows(f)]
        limit = np.where(self.model.revolute, 0.15, 5.0)
        for i in range(JOINT_SCHEDULE.iterations):
            T = self._forward(f, q)
            y, ny = transform_by(T, (config, label), self.x[point]), rotate_by(T, (config, label), self.nx[point])
            z, nz, d, r, agreement = match(tree, normals, y, ny)
            w = geman_mcclure(r * r + 0.1 * d * d, JOINT_SCHEDULE.scale(i)) * np.where(agreement > 0.4, agreement, 0.05)
            H, g = normal_equations(y, z, nz, w, JOINT_SCHEDULE.point_share * w, config * P + label, C * P)
            J = joint_jacobian(self.model.parent, self.model.twist, T) * free[:, None, None, :]
            A = np.einsum("cpik,cpil->ckl", J, H.reshape(C, P, 6, 6) @ J)
            b = np.einsum("cpik,cpi->ck", J, g.reshape(C, P, 6))
            damping = np.where(self.model.revolute, 0.35, 1e-5) + (1 - free) * 1e9
            step = -np.linalg.solve(A + np.eye(P) * damping[:, None, :], b[..., None])[..., 0]
            q += np.clip(step, -limit, limit)
            if np.abs(step).max() < 5e-4:
                break
        return q

    def _choose(self, f: int, branches: list[Branch], starts: list[list[Array]]) -> int:
        """Refine all starts of all branches; a branch takes another configuration when it is better by the margin."""
        config = [b for b, s in zip(branches, starts, strict=True) for _ in s]
        q0 = np.stack([q for s in starts for q in s])
        q1 = self.refine(f, q0, config)
        sets, parts = [b.points for b in config], [b.parts for b in config]
        score = self.cost(f, q1, sets) + self.missing(f, q1, parts)
        k, changed = 0, 0
        for b, s in zip(branches, starts, strict=True):
            now = self.cost(f, q0[[k]], [b.points])[0] + self.missing(f, q0[[k]], [b.parts])[0]
            penalty = np.where(np.arange(len(s)) == 0, 0.0, MARGIN)
            best = k + int((score[k : k + len(s)] + penalty).argmin())
            if score[best] < now - MARGIN:
                self.q[f, b.parts] = q1[best, b.parts]
                changed += 1
            k += len(s)
        return changed

    def restart_branches(self, f: int, u: int) -> int:
        """Try other frames' joint values for every branch of the root. u: the frame before."""
        branches = []
        for j in np.flatnonzero(self.model.parent == 0):
            b = self.branch(int(j))
            if b is not None and self.suspicious(f, b):
                branches.append(b)
        starts = []
        for b in branches:
            values = [self.q[f], self.q[u]]
            if u != self.canonical:
                values.append(2 * self.q[u] - self.q[2 * u - f])
            if 0 <= 2 * f - u < len(self.q):
                values.append((self.q[u] + self.q[2 * f - u]) / 2)
            starts.append([self._with(f, b, v) for v in values])
        return self._choose(f, branches, starts) if branches else 0

    def suspicious(self, f: int, branch: Branch) -> bool:
        """Does the branch fit frame f worse than its better frames?"""
        now = self.cost(f, self.q[[f]], [branch.points])[0] + self.missing(f, self.q[[f]], [branch.parts])[0]
        best = self.best.get(branch.top, np.inf)
        self.best[branch.top] = min(best, now)
        return now > BRANCH_SUSPICION * self.best[branch.top] or best == np.inf

    def _with(self, f: int, branch: Branch, values: Array) -> Array:
        q = self.q[f].copy()
        q[branch.parts] = values[branch.parts]
        return q

    def sweep(self, f: int, usual: Array) -> int:
        """Root to leaf: sweep a part that fits worse than usual through all values of its joint."""
        changed = 0
        for j in range(1, self.model.n_parts):
            branch = self.branch(j)
            own = np.flatnonzero(self.labels == j)
            if branch is None or len(own) < MINIMUM_POINTS or not self.model.revolute[j]:
                continue
            own = own[:: max(1, len(own) // SUBSET)]
            now = self.cost(f, self.q[[f]], [own])[0] + self.missing(f, self.q[[f]], [np.array([j])])[0]
            if now <= SUSPICION * usual[j]:
                continue
            grid = np.deg2rad(np.arange(-SWEEP_DEG, SWEEP_DEG + 1, SWEEP_STEP_DEG))
            q = np.repeat(self.q[[f]], len(grid), axis=0)
            q[:, j] += grid
            score = self.cost(f, q, [own] * len(q))
            short = np.argsort(score, kind="stable")[:6]
            score = score[short] + self.missing(f, q[short], [np.array([j])] * len(short))
            best = short[np.argsort(score, kind="stable")[:2]]
            changed += self._choose(f, [branch], [[self.q[f], *q[best]]])
        return changed

    def usual_cost(self) -> Array:
        """(P,) lowest two-sided misfit of every part over the frames."""
        P = self.model.n_parts
        own = [np.flatnonzero(self.labels == p) for p in range(P)]
        own = [o[:: max(1, len(o) // SUBSET)] for o in own]
        present = [p for p in range(1, P) if len(own[p]) >= MINIMUM_POINTS]
        out = np.full(P, np.inf)
        for f in range(len(self.q)):
            if f != self.canonical and present:
                q = np.repeat(self.q[[f]], len(present), axis=0)
                cost = self.cost(f, q, [own[p] for p in present]) + self.missing(f, q, [np.array([p]) for p in present])
                out[present] = np.minimum(out[present], cost)
        return out


def repair_joints(
    frames: Frames,
    canonical: int,
    model: Articulated,
    labels: IntArray,
    rng: np.random.Generator,
    told: Told = untold,
) -> tuple[Articulated, int]:
    """Restart branches and sweep badly fitting parts in every frame, from the canonical frame outwards."""
    repairer = JointRepairer(frames, canonical, model, labels, rng)
    usual, changed = repairer.usual_cost(), 0
    for done, (f, before) in enumerate(outwards(canonical, frames.n_frames), start=1):
        changed += repairer.restart_branches(f, before)
        changed += repairer.sweep(f, usual)
        told(done / (frames.n_frames - 1))
    return replace(model, q=repairer.q), changed
