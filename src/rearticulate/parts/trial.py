"""Trial merges: would one rigid body, registered anew, explain the points of two parts as well as two do?"""

from __future__ import annotations

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import rotate_by, transform_by
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import Schedule, fit_cost, register_bodies
from rearticulate.parts.cluster import adjacent_labels
from rearticulate.parts.relaxed import Relaxed, keep_parts
from rearticulate.progress import Told, rounds, steps, untold

Pair = tuple[int, int]

BODY_SCHEDULE = Schedule(iterations=8, sigma=2.2, sigma_end=0.56)
SUBSET = 90  # points of a part that take part in a trial (`Trials.subset`)
GAP = 4.0  # spacings; parts closer than this may be tried
UNCONFIRMED = 1.0  # misfit from which a frame shows nothing there
BORDER = 0.5  # what a border as long as the smaller part has points is worth when pairs compete


class Trials:
    """Registers sets of canonical points, as rigid bodies, to every frame from given starts and compares their cost."""

    def __init__(self, frames: Frames, canonical: int, rng: np.random.Generator):
        rows = frames.rows(canonical)
        self.frames, self.canonical, self.rng = frames, canonical, rng
        self.x, self.nx = frames.points[rows], frames.normals[rows]
        self.near = frames.neighbours[rows] - rows.start
        self.others = [f for f in range(frames.n_frames) if f != canonical]

    def subset(self, labels: Int[Array, " N"], part: int, size: int) -> Int[Array, " n"]:
        """At most `size` points of a part; more of a sequence of fewer than ten frames, for the same evidence."""
        rows = np.flatnonzero(labels == part)
        size = max(size, 9 * size // len(self.others))
        return rows if len(rows) <= size else self.rng.choice(rows, size, replace=False)

    def cost(
        self, f: int, point: Int[Array, " n"], body: Int[Array, " n"], T: Float[Array, "B 4 4"]
    ) -> Float[Array, " n"]:
        """Misfit in frame f of canonical points `point` carried by T[body]."""
        y, ny = transform_by(T, body, self.x[point]), rotate_by(T, body, self.nx[point])
        return fit_cost(self.frames.trees[f], self.frames.normals[self.frames.rows(f)], y, ny)

    def register(
        self, f: int, point: Int[Array, " n"], body: Int[Array, " n"], T: Float[Array, "B 4 4"], schedule: Schedule
    ) -> tuple[Float[Array, "B 4 4"], Float[Array, " n"]]:
        """Registered poses and the misfit of every point under them."""
        normals = self.frames.normals[self.frames.rows(f)]
        T = register_bodies(self.frames.trees[f], normals, self.x[point], self.nx[point], body, T, schedule)
        return T, self.cost(f, point, body, T)

    def seen(
        self,
        f: int,
        point: Int[Array, " n"],
        body: Int[Array, " n"],
        T: Float[Array, "B 4 4"],
        cost: Float[Array, " n"],
    ) -> Float[Array, " n"]:
        """These misfits, nan where frame f cannot tell: it has nothing there and sees no further."""
        if self.frames.views is None:
            return cost
        far = np.flatnonzero(cost > UNCONFIRMED)
        blind = self.frames.views.blind(transform_by(T, body[far], self.x[point[far]]), np.full(len(far), f))
        out = cost.copy()
        out[far[blind]] = np.nan
        return out


def mean_by(body: Int[Array, " n"], value: Float[Array, " n"], n: int) -> Float[Array, " B"]:
    return np.bincount(body, value, minlength=n) / np.maximum(np.bincount(body, minlength=n), 1)


def flatten(sets: list[Int[Array, " _"]]) -> tuple[Int[Array, " n"], Int[Array, " n"]]:
    """Concatenated members and the number of the set each belongs to."""
    return np.concatenate(sets), np.repeat(np.arange(len(sets)), [len(s) for s in sets])


def own_cost(
    trials: Trials, T: Float[Array, "F P 4 4"], parts: list[int], subsets: dict[int, Int[Array, " _"]]
) -> dict[int, Float[Array, "F-1 _"]]:
    """Misfit of the subset of each part in the other frames, now or after registration by itself; nan where a frame
    cannot tell."""
    point, body = flatten([subsets[p] for p in parts])
    out, P = np.empty((len(trials.others), len(point))), len(parts)
    for i, f in enumerate(trials.others):
        here, now = T[f, parts], trials.cost(f, point, body, T[f, parts])
        moved, then = trials.register(f, point, body, here, Schedule(6, 2.2, 0.56))
        better = mean_by(body, then, P) < mean_by(body, now, P)
        best = np.where(better[:, None, None], moved, here)
        out[i] = trials.seen(f, point, body, best, np.where(better[body], then, now))
    return {p: out[:, body == k] for k, p in enumerate(parts)}


def try_pairs(
    trials: Trials,
    T: Float[Array, "F P 4 4"],
    pairs: list[Pair],
    subsets: dict[int, Int[Array, " _"]],
    own: dict[int, Float[Array, "F-1 _"]],
    told: Told = untold,
) -> dict[Pair, tuple[float, Float[Array, "F 4 4"]]]:
    """Score and common motion of every pair: growth of the misfit when one body carries both, as far as the frames tell
    of both.

    The score is the larger growth of the two parts (mean over the frames, or half the mean of the worst quarter),
    less the sampling error of that mean and an allowance for parts so small that they overfit.
    """
    sets = [np.concatenate([subsets[a], subsets[b]]) for a, b in pairs]
    side = np.concatenate(
        [np.repeat([2 * k, 2 * k + 1], [len(subsets[a]), len(subsets[b])]) for k, (a, b) in enumerate(pairs)]
    )
    point, body = flatten(sets)
    n, F = len(pairs), trials.frames.n_frames
    common = np.tile(np.eye(4), (n, F, 1, 1))
    growth = np.empty((len(trials.others), 2 * n))
    for i, f in enumerate(trials.others):
        starts = np.concatenate([T[f, [a for a, _ in pairs]], T[f, [b for _, b in pairs]]])
        T_new, cost = trials.register(f, np.tile(point, 2), np.concatenate([body, body + n]), starts, BODY_SCHEDULE)
        mean = mean_by(np.concatenate([body, body + n]), cost, 2 * n)
        best = np.where(mean[:n] <= mean[n:], 0, 1)
        common[:, f] = T_new[np.arange(n) + n * best]
        chosen = cost.reshape(2, -1)[best[body], np.arange(len(body))]
        before = np.concatenate([own[p][i] for pair in pairs for p in pair])
        after = trials.seen(f, point, body, common[:, f], chosen)
        growth[i] = mean_by(side, np.nan_to_num(after - before), 2 * n)
        told((i + 1) / len(trials.others))
    out = {}
    for k, (a, b) in enumerate(pairs):
        d = growth[:, 2 * k : 2 * k + 2]
        worst = np.sort(d, axis=0)[-max(1, len(d) // 4) :].mean(axis=0)
        smaller = min(len(subsets[a]), len(subsets[b]))
        error = 0.45 / np.sqrt(len(d) * smaller / 3)
        out[a, b] = (
            float(np.maximum(d.mean(axis=0), 0.5 * worst).max() - error - max(3.0 / smaller - 0.03, 0.0)),
            common[k],
        )
    return out


def _candidates(trials: Trials, labels: Int[Array, " N"], parts: list[int], gap: float) -> set[Pair]:
    """Pairs of parts that touch in the neighbour graph or across a gap."""
    pairs = {e for e in adjacent_labels(trials.x, labels) if e[0] in parts and e[1] in parts}
    trees = {p: search_tree(trials.x[labels == p]) for p in parts}
    for i, p in enumerate(parts):
        for q in parts[i + 1 :]:
            if (p, q) not in pairs and nearest(trees[p], trees[q].data, within=gap)[0].min() < gap:
                pairs.add((p, q))
    return pairs


def shared_border(near: Int[Array, "N K"], labels: Int[Array, " N"], P: int) -> Float[Array, "P P"]:
    """Length of the border between parts, in points: neighbours near (N, K) of points of one that belong to the
    other."""
    pairs = np.bincount(np.repeat(labels, near.shape[1]) * P + labels[near].ravel(), minlength=P * P).reshape(P, P)
    return (pairs + pairs.T) / (2 * near.shape[1])


def trial_merge(
    frames: Frames,
    canonical: int,
    model: Relaxed,
    threshold: float,
    rng: np.random.Generator,
    told: Told = untold,
) -> Relaxed:
    """Merge pairs of parts, mutually best pairs first, while the score stays below the threshold.

    A fragment that moves in its own surface fits several neighbours equally well; it goes to the one it borders on.
    """
    trials = Trials(frames, canonical, rng)
    labels, T = model.labels[frames.rows(canonical)].copy(), model.T.copy()
    into = np.arange(model.n_parts)
    parts = [p for p in range(model.n_parts) if (labels == p).sum() > 3]
    subsets = {p: trials.subset(labels, p, SUBSET) for p in parts}
    own = own_cost(trials, T, parts, subsets)
    pairs = _candidates(trials, labels, parts, GAP)
    first, later = steps(told, 2)
    scores = try_pairs(trials, T, sorted(pairs), subsets, own, first) if pairs else {}
    for _ in rounds(later):
        border = shared_border(trials.near[:, :8], labels, model.n_parts)
        counts = np.bincount(labels, minlength=model.n_parts)
        rank = {
            (a, b): score - BORDER * border[a, b] / min(counts[a], counts[b])
            for (a, b), (score, _) in scores.items()
            if score < threshold
        }
        lowest: dict[int, float] = {}
        for pair, value in rank.items():
            for p in pair:
                lowest[p] = min(lowest.get(p, np.inf), value)
        chosen = [e for e, value in rank.items() if value == lowest[e[0]] == lowest[e[1]]]
        if not chosen:
            break
        for a, b in chosen:
            T[:, a] = scores[a, b][1]
            labels[labels == b] = a
            into[into == b] = a
        merged = {b: a for a, b in chosen}
        touched = {a for a, _ in chosen}
        for a in touched:
            subsets[a] = trials.subset(labels, a, SUBSET)
        own.update(own_cost(trials, T, sorted(touched), subsets))
        renamed = {
            (min(p, q), max(p, q)) for p, q in ((merged.get(a, a), merged.get(b, b)) for a, b in scores) if p != q
        }
        scores = {e: v for e, v in scores.items() if e in renamed and not set(e) & (touched | merged.keys())}
        fresh = sorted(renamed - scores.keys())
        if fresh:
            scores.update(try_pairs(trials, T, fresh, subsets, own))
    return keep_parts(frames, Relaxed(T, into[model.labels]), np.unique(into))
