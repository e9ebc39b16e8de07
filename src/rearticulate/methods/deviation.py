"""The paper's rules for merging parts and joining them to a tree (CVPR 2023, sec. 3.3.2 and supplement A.2, A.3).

All from the squared Frobenius deviation of relative motions, and from how near two parts come. Lengths are in metres of
an object scaled to a given radius, so that its thresholds mean the same for every object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.config import DeviationConfig
from rearticulate.geometry.nearest import nearest, rms_radius, search_tree
from rearticulate.geometry.se3 import inverse, to_unit, transform
from rearticulate.joints.chains import ChainFit, fit_prismatic, fit_revolute, rest_cost
from rearticulate.joints.tree import Link, Projection, assemble, spanning_tree
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import Relaxed, keep_parts, merge_pair
from rearticulate.progress import Told, rounds, untold


@dataclass(frozen=True)
class Parts:
    """A relaxed model about the centroid of its canonical points.

    In point spacings; scale: metres of the paper's unit a spacing.
    """

    T: Float[Array, "F P 4 4"]
    points: Float[Array, "N 3"]
    labels: Int[Array, " N"]
    canonical: int
    scale: float
    centre: Float[Array, " 3"]

    def relative(
        self, a: Int[Array, " B"], b: Int[Array, " B"]
    ) -> tuple[Float[Array, "B F 4 4"], Float[Array, "B F 6 6"]]:
        """Motion of parts a seen from parts b, and its information: see `deviation`."""
        T = np.swapaxes(self.T, 0, 1)
        A = inverse(T[b]) @ T[a]
        return A, np.broadcast_to(np.diag([2.0 / self.scale**2] * 3 + [1.0] * 3), (*A.shape[:2], 6, 6))

    def deviation(self, cost: Float[Array, " B"]) -> Float[Array, " B"]:
        """Cost under that information -> mean over the frames of the squared Frobenius deviation, for small ones."""
        return self.scale**2 * cost / max(1, len(self.T) - 1)

    def gaps(self) -> Float[Array, "P P"]:
        """Squared distance of the nearest points of two parts, mean over the frames (E_spatial)."""
        F, P = self.T.shape[:2]
        gap = np.zeros((P, P))
        moved = [transform(self.T[:, p, None], self.points[self.labels == p]) for p in range(P)]
        for f in range(F):
            trees = [search_tree(m[f]) for m in moved]
            for p in range(P):
                for q in range(p):
                    gap[p, q] += nearest(trees[q], moved[p][f])[0].min() ** 2 / F
        return self.scale**2 * (gap + gap.T)

    def spread(self) -> float:
        """E_group: mean over the parts of the mean squared distance of their points from their centroid."""
        members = [self.points[self.labels == p] for p in np.unique(self.labels)]
        return self.scale**2 * float(np.mean([m.var(axis=0).sum() for m in members]))


def centred(frames: Frames, canonical: int, model: Relaxed, radius: float) -> Parts:
    """The canonical points and motions about their centroid; they would have this rms radius in the paper's unit."""
    rows = frames.rows(canonical)
    points = frames.points[rows]
    centre = points.mean(axis=0)
    scale = radius / rms_radius(points)
    return Parts(to_unit(model.T, 1.0, centre), points - centre, model.labels[rows], canonical, scale, centre)


def merge_still(
    frames: Frames, canonical: int, model: Relaxed, config: DeviationConfig, told: Told = untold
) -> Relaxed:
    """Merge parts that do not move against each other, the nearest pair first (supplement, "Merging").

    The larger part of a pair gives its motion. Parts without points in the canonical frame are not there.
    """
    rows = frames.rows(canonical)
    model = keep_parts(frames, model, np.unique(model.labels[rows]))
    for _ in rounds(told):
        if model.n_parts == 1:
            break
        parts = centred(frames, canonical, model, config.radius)
        a, b = np.tril_indices(model.n_parts, -1)
        gap = parts.gaps()[a, b]
        still = (parts.deviation(rest_cost(*parts.relative(a, b))) < config.merge) & (gap < config.merge_gap**2)
        if not still.any():
            break
        best = int(np.where(still, gap, np.inf).argmin())
        counts = np.bincount(parts.labels, minlength=model.n_parts)
        model = merge_pair(frames, model, int(a[best]), int(b[best]), counts)
    return model


def fit_screws(parts: Parts, a: Int[Array, " B"], b: Int[Array, " B"]) -> ChainFit:
    """The better of a revolute and a prismatic joint of each pair; cost: its E_1-DOF (paper eq. 12)."""
    A, W = parts.relative(a, b)
    turn = fit_revolute(A, W, parts.canonical)
    centre = np.stack([parts.points[parts.labels == p].mean(axis=0) for p in a])
    slide = fit_prismatic(A, W, centre, parts.canonical)
    sliding = slide.cost < turn.cost
    return ChainFit(
        cost=parts.deviation(np.where(sliding, slide.cost, turn.cost)),
        twist=np.where(sliding[:, None, None], slide.twist, turn.twist),
        q=np.where(sliding[:, None, None], slide.q, turn.q),
        revolute=~sliding[:, None],
    )


def least_tree(
    parts: Parts,
    joint_cost: Callable[[Int[Array, " B"], Int[Array, " B"]], Float[Array, " B"]],
    config: DeviationConfig,
    root: int,
) -> tuple[Int[Array, " P"], Int[Array, " P-1"], float]:
    """The tree with the least sum of joint_cost(a, b) and E_spatial: parents, the parts but the root, parents first,
    and that sum."""
    P = parts.T.shape[1]
    a, b = np.tril_indices(P, -1)
    cost = np.zeros((P, P))
    if P > 1:
        cost[a, b] = joint_cost(a, b)
        cost = cost + cost.T + config.spatial * parts.gaps()
    parent, order = spanning_tree(cost, root)
    child = order[1:]
    return parent, child, float(cost[child, parent[child]].sum())


def project_deviation(
    frames: Frames, canonical: int, model: Relaxed, config: DeviationConfig, root: int
) -> tuple[Projection, float]:
    """The tree with the least E_project = E_spatial + E_1-DOF (paper eq. 11), and that cost."""
    parts = centred(frames, canonical, model, config.radius)
    P = model.n_parts
    parent, child, cost = least_tree(parts, lambda a, b: config.one_dof * fit_screws(parts, a, b).cost, config, root)
    links = []
    if P > 1:
        screws = fit_screws(parts, child, parent[child])
        links = [_link(int(c), int(parent[c]), screws.take(i), parts.centre) for i, c in enumerate(child)]
    tree, number = assemble(links, model.T[:, root], root, P)
    return Projection(tree, (number[model.labels],), number[P:]), cost


def _link(child: int, parent: int, screw: ChainFit, centre: Float[Array, " 3"]) -> Link:
    """A joint, about the origin of the frames."""
    w, v, revolute = screw.twist[0, :3], screw.twist[0, 3:], bool(screw.revolute[0])
    return Link(child, parent, np.concatenate([w, v + np.cross(centre, w)]), screw.q[:, 0], revolute)
