"""Over-segmentation: patches that move alike are agglomerated by the growth of their rigid-fit error (Ward 1963)."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.parts.patches import Tracks

SIGMA = 0.75  # spacings; deviation of a tracked point


@dataclass
class Moments:
    """Sums over the points of each cluster that fix its best rigid motion to every frame (Kabsch 1976)."""

    n: Float[Array, " K"]
    x: Float[Array, "K 3"]
    xx: Float[Array, " K"]
    y: Float[Array, "K F 3"]
    yy: Float[Array, "K F"]
    xy: Float[Array, "K F 3 3"]

    def fields(self) -> tuple[Float[Array, "K ..."], ...]:
        return self.n, self.x, self.xx, self.y, self.yy, self.xy

    def take(self, k: Sequence[int] | Int[Array, " k"]) -> Moments:
        return Moments(*(a[k] for a in self.fields()))

    def plus(self, other: Moments) -> Moments:
        return Moments(*(a + b for a, b in zip(self.fields(), other.fields(), strict=True)))

    def store(self, k: int, other: Moments) -> None:
        for mine, theirs in zip(self.fields(), other.fields(), strict=True):
            mine[k] = theirs[0]

    def covariance(self) -> Float[Array, "K F 3 3"]:
        n = self.n[:, None, None, None]
        return self.xy - self.x[:, None, :, None] * self.y[:, :, None, :] / n

    def squared_error(self) -> Float[Array, "K F"]:
        """Sum of squared distances under the best rigid motion."""
        n = self.n[:, None]
        spread_x = self.xx[:, None] - (self.x**2).sum(-1)[:, None] / n
        spread_y = self.yy - (self.y**2).sum(-1) / n
        C = self.covariance()
        s = np.linalg.svd(C, compute_uv=False)
        alignment = s[..., 0] + s[..., 1] + np.sign(np.linalg.det(C)) * s[..., 2]
        return np.maximum(spread_x + spread_y - 2 * alignment, 0)

    def motion(self) -> Float[Array, "K F 4 4"]:
        """Best rigid motion from x to y."""
        U, _, Vt = np.linalg.svd(self.covariance())
        D = np.zeros_like(U)
        D[..., 0, 0] = D[..., 1, 1] = 1.0
        D[..., 2, 2] = np.linalg.det(U @ Vt)
        R = np.swapaxes(Vt, -1, -2) @ D @ np.swapaxes(U, -1, -2)
        T = np.zeros((*R.shape[:2], 4, 4))
        T[..., :3, :3] = R
        mean_x, mean_y = self.x / self.n[:, None], self.y / self.n[:, None, None]
        T[..., :3, 3] = mean_y - np.einsum("kfij,kj->kfi", R, mean_x)
        T[..., 3, 3] = 1.0
        return T


def moments(x: Float[Array, "N 3"], y: Float[Array, "F N 3"], label: Int[Array, " N"], K: int) -> Moments:
    """Moments of points x that move to y, per label."""
    one_hot = np.zeros((K, len(x)))
    one_hot[label, np.arange(len(x))] = 1.0
    xy = np.einsum("ni,fnj->nfij", x, y).reshape(len(x), -1)
    F = len(y)
    return Moments(
        n=one_hot.sum(1),
        x=one_hot @ x,
        xx=one_hot @ (x * x).sum(1),
        y=(one_hot @ y.transpose(1, 0, 2).reshape(len(x), -1)).reshape(K, F, 3),
        yy=one_hot @ (y * y).sum(-1).T,
        xy=(one_hot @ xy).reshape(K, F, 3, 3),
    )


def adjacent_labels(points: Float[Array, "N 3"], label: Int[Array, " N"], neighbours: int = 10) -> set[tuple[int, int]]:
    """Pairs of labels (a < b) that touch in the nearest-neighbour graph."""
    _, j = nearest(search_tree(points), points, k=min(neighbours, len(points)))
    a, b = np.repeat(label, j.shape[1] - 1), label[j[:, 1:]].ravel()
    pairs = np.unique(np.sort(np.stack([a, b], 1)[a != b], axis=1), axis=0)
    return {(int(p), int(q)) for p, q in pairs}


def cluster(tracks: Tracks, penalty: float, max_fragments: int) -> tuple[Int[Array, " N"], Float[Array, "F P 4 4"]]:
    """Merge neighbouring patches, cheapest first, until the cheapest merge costs more than the penalty and there are no
    more fragments than allowed. penalty: growth of the rigid-fit error, in SIGMA^2 a frame.

    Returns labels (N,) of the canonical points and T (F, P, 4, 4). Errors inside a patch are correlated, hence the
    square root of the smaller size instead of the size.
    """
    patches = tracks.patches
    y = transform(tracks.T[:, patches.owner], patches.points)
    K, F = patches.count, len(y)
    stats = moments(patches.points, y, patches.owner, K)
    error = stats.squared_error()
    touching: list[set[int]] = [set() for _ in range(K)]
    for a, b in adjacent_labels(patches.points, patches.owner):
        touching[a].add(b)
        touching[b].add(a)
    alive, version, into = np.ones(K, bool), np.zeros(K, int), np.arange(K)
    queue: list[tuple[float, int, int, int, int]] = []

    def push(a: int, others: list[int]) -> None:
        joint = stats.take([a] * len(others)).plus(stats.take(others))
        growth = (joint.squared_error() - error[a] - error[others]).sum(1)
        cost = growth / SIGMA**2 / F / np.sqrt(np.minimum(stats.n[a], stats.n[others]))
        for b, c in zip(others, cost, strict=True):
            p, q = min(a, b), max(a, b)
            heapq.heappush(queue, (float(c), p, q, int(version[p]), int(version[q])))

    for a in range(K):
        later = [b for b in sorted(touching[a]) if b > a]
        if later:
            push(a, later)
    while queue:
        cost, a, b, va, vb = heapq.heappop(queue)
        if not (alive[a] and alive[b]) or version[a] != va or version[b] != vb:
            continue
        if cost > penalty and alive.sum() <= max_fragments:
            break
        stats.store(a, stats.take([a]).plus(stats.take([b])))
        error[a] = stats.take([a]).squared_error()[0]
        alive[b], into[into == b] = False, a
        version[a] += 1
        for k in touching[b]:
            touching[k].discard(b)
            touching[k].add(a)
        touching[a] = (touching[a] | touching[b]) - {a, b}
        if touching[a]:
            push(a, sorted(touching[a]))
    names = np.flatnonzero(alive)
    number = np.full(K, -1)
    number[names] = np.arange(len(names))
    return number[into[patches.owner]], np.swapaxes(stats.take(names).motion(), 0, 1)
