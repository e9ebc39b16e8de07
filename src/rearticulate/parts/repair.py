"""Lost parts: every part of every frame is started again from many poses, also by an exhaustive turn about its joint.

The misfit of a pose counts both ways: how the part's points land on the frame, and how many points of the frame that
no other part explains stay unexplained. The second term keeps a small part from hiding on another one's surface.
"""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import contact, nearest, search_tree
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import Schedule
from rearticulate.parts.relaxed import Relaxed
from rearticulate.parts.trial import Trials, flatten, mean_by, shared_border
from rearticulate.progress import Told, untold

RESTART_SCHEDULE = Schedule(iterations=6, sigma=2.2, sigma_end=0.56)
SUBSET = 150  # points of a part that take part in a restart (`parts.trial.Trials.subset`)
MINIMUM_POINTS = 12  # of a part that is started again
MARGIN = 0.06  # spacings; another pose must lower the misfit by this much to be taken
UNEXPLAINED = 1.5  # spacings; a point farther than this from every other part is unexplained
MAX_UNEXPLAINED = 300  # points
REACH = 4.0  # spacings; an unexplained point costs at most this much
BACKWARD_WEIGHT = 0.3  # of the unexplained points, against the part's own misfit
SUSPICION = 1.3  # a misfit above this times the part's best one calls for a search
PIVOT_SUBSET = 40  # points of a part that judge turns about a joint
PIVOT_RADIUS_DEG = 50.0  # turns about a joint are searched this far
PIVOT_STEP_DEG = 12.5
PIVOT_KEEP = 3  # of these turns are registered


def rotation_ball(radius: float, step: float) -> Float[Array, "R 3 3"]:
    """Rotations on a cubic grid of rotation vectors within the radius, rad."""
    n = int(radius / step)
    grid = np.stack(np.meshgrid(*[np.arange(-n, n + 1) * step] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid = grid[np.linalg.norm(grid, axis=1) <= radius]
    return exp_se3(np.concatenate([grid, np.zeros_like(grid)], 1))[:, :3, :3]


def about(R: Float[Array, "R 3 3"], pivot: Float[Array, " 3"]) -> Float[Array, "R 4 4"]:
    """Rotations R about a point."""
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3] = R
    T[:, :3, 3] = pivot - R @ pivot
    return T


def border_neighbours(near: Int[Array, "N K"], labels: Int[Array, " N"], P: int, n: int) -> list[list[int]]:
    """For every part the n parts that share most of its border. near: neighbours of every point."""
    shared = shared_border(near, labels, P)
    np.fill_diagonal(shared, 0)
    return [[int(b) for b in np.argsort(-shared[p], kind="stable")[:n] if shared[p, b] > 0] for p in range(P)]


class Repairer:
    """Restarts the parts of one relaxed model."""

    def __init__(self, frames: Frames, canonical: int, model: Relaxed, rng: np.random.Generator):
        self.trials = Trials(frames, canonical, rng)
        self.frames, self.canonical = frames, canonical
        self.labels = model.labels[frames.rows(canonical)]
        self.T = model.T.copy()
        self.parts = [p for p in range(model.n_parts) if (self.labels == p).sum() >= MINIMUM_POINTS]
        self.subsets = {p: self.trials.subset(self.labels, p, SUBSET) for p in self.parts}
        self.few = {p: s[:PIVOT_SUBSET] for p, s in self.subsets.items()}
        self.near = border_neighbours(self.trials.near[:, :9], self.labels, model.n_parts, 2)
        self.pivots = {(p, b): self._contact(p, b) for p in self.parts for b in self.near[p]}
        self.usual: dict[int, float] = {}
        self.neighbours_of_canonical = (canonical - 1, canonical + 1)
        self.ball = rotation_ball(np.deg2rad(PIVOT_RADIUS_DEG), np.deg2rad(PIVOT_STEP_DEG))

    def _contact(self, a: int, b: int, n: int = 10) -> Float[Array, " 3"]:
        xa, xb = self.trials.x[self.labels == a], self.trials.x[self.labels == b]
        return contact(xa, xb, n)

    def unexplained(self, f: int) -> dict[int, Float[Array, "_ 3"]]:
        """Per part the points of frame f that no other part reaches."""
        y = transform(self.T[f, self.labels], self.trials.x)
        target = self.frames.points[self.frames.rows(f)]
        d, j = nearest(search_tree(y), target, k=8)
        owner = self.labels[j]
        out = {}
        for p in self.parts:
            foreign = owner != p
            first = np.where(foreign.any(axis=1), foreign.argmax(axis=1), 7)
            u = target[d[np.arange(len(d)), first] > UNEXPLAINED]
            out[p] = u[:: max(1, len(u) // MAX_UNEXPLAINED)]
        return out

    def backward(self, p: int, T: Float[Array, "S 4 4"], points: Float[Array, "n 3"]) -> Float[Array, " S"]:
        """Capped distances of unexplained points to part p under poses T, summed, per part point."""
        if len(points) == 0:
            return np.zeros(len(T))
        tree = search_tree(self.trials.x[self.labels == p])
        back = transform(inverse(T)[:, None], points[None])
        d = nearest(tree, back.reshape(-1, 3), within=REACH)[0].reshape(len(T), -1)
        return np.minimum(d, REACH).sum(axis=1) * BACKWARD_WEIGHT / max(tree.n, 20)

    def starts(self, f: int, u: int, p: int) -> list[Float[Array, "4 4"]]:
        """Own pose, velocity, what the neighbours do. u: the frame before f, seen outwards."""
        T, before = self.T, 2 * u - f
        out = [T[f, p]]
        if u != self.canonical:
            out.append(T[u, p] @ inverse(T[before, p]) @ T[u, p])
        return out + [T[f, b] @ inverse(T[u, b]) @ T[u, p] for b in self.near[p]]

    def turned(self, f: int, u: int, p: int, unexplained: Float[Array, "n 3"]) -> list[Float[Array, "4 4"]]:
        """The best few poses among all turns about the contact with a neighbour."""
        out: list[Float[Array, "4 4"]] = []
        for b in self.near[p]:
            carried = self.T[f, b] @ inverse(self.T[u, b]) @ self.T[u, p]
            poses = carried @ about(self.ball, self.pivots[p, b])
            point, body = flatten([self.few[p]] * len(poses))
            cost = mean_by(body, self.trials.cost(f, point, body, poses), len(poses))
            short = np.argsort(cost, kind="stable")[: 8 * PIVOT_KEEP]
            cost = cost[short] + self.backward(p, poses[short], unexplained)
            out += list(poses[short[np.argsort(cost, kind="stable")[:PIVOT_KEEP]]])
        return out

    def suspicious(self, f: int, unexplained: dict[int, Float[Array, "_ 3"]]) -> list[int]:
        """Parts whose misfit in frame f is well above what they reach in their better frames."""
        out = []
        for p in self.parts:
            own = self.subsets[p]
            body = np.zeros(len(own), dtype=np.int64)
            cost = self.trials.cost(f, own, body, self.T[f, [p]]).mean()
            cost += float(self.backward(p, self.T[f, [p]], unexplained[p])[0])
            self.usual[p] = min(self.usual.get(p, np.inf), cost)
            if cost > SUSPICION * self.usual[p] or f in self.neighbours_of_canonical:
                out.append(p)
        return out

    def repair_frame(self, f: int, u: int) -> int:
        """Restart all parts in frame f; returns how many took another pose."""
        unexplained = self.unexplained(f)
        starts = [self.starts(f, u, p) for p in self.parts]
        for p in self.suspicious(f, unexplained):
            starts[self.parts.index(p)] += self.turned(f, u, p, unexplained[p])
        point, body = flatten([self.subsets[p] for p, s in zip(self.parts, starts, strict=True) for _ in s])
        T0 = np.stack([T for s in starts for T in s])
        T1, cost = self.trials.register(f, point, body, T0, RESTART_SCHEDULE)
        after = mean_by(body, cost, len(T0))
        before = mean_by(body, self.trials.cost(f, point, body, T0), len(T0))
        changed, k = 0, 0
        for p, s in zip(self.parts, starts, strict=True):
            rows = slice(k, k + len(s))
            back = self.backward(p, np.concatenate([T1[rows], T0[k : k + 1]]), unexplained[p])
            score = after[rows] + back[:-1]
            best = int(score.argmin())
            if best > 0 and score[best] < score[0] - MARGIN:
                self.T[f, p] = T1[k + best]
                changed += 1
            elif score[0] < before[k] + back[-1]:
                self.T[f, p] = T1[k]
            k += len(s)
        return changed


def outwards(canonical: int, count: int) -> list[tuple[int, int]]:
    """All other frames, from the canonical one to the end and then to the beginning, each with the one before it."""
    later, earlier = range(canonical + 1, count), range(canonical - 1, -1, -1)
    return [*((f, f - 1) for f in later), *((f, f + 1) for f in earlier)]


def repair_poses(
    frames: Frames,
    canonical: int,
    model: Relaxed,
    rng: np.random.Generator,
    told: Told = untold,
) -> Relaxed:
    """From the canonical frame outwards, restart every part; another pose is taken when it is better by the margin."""
    repairer = Repairer(frames, canonical, model, rng)
    if repairer.parts:
        for done, (f, before) in enumerate(outwards(canonical, frames.n_frames), start=1):
            repairer.repair_frame(f, before)
            told(done / (frames.n_frames - 1))
    return Relaxed(repairer.T, model.labels)
