"""From freely moving parts to a tree of one-degree-of-freedom joints (paper eq. 11 and 12, by chi-square tests).

For a pair of parts X_k is the chi-square per degree of freedom of k joints between them, k = 0 to 3. X_0 near 1: one
part. X_1 near 1: a joint. X_1 large but X_2 or X_3 small: links without points of their own hide between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.config import FitConfig
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.joints.bundle import adjust_to_poses
from rearticulate.joints.chains import ChainFit, fit_prismatic, fit_revolute, fit_series, relative_motion
from rearticulate.joints.evidence import Evidence, contact_point, gather_evidence
from rearticulate.joints.tree import Link, Projection, assemble, choose_root, spanning_tree
from rearticulate.observe.frames import Frames
from rearticulate.observe.views import HIDDEN, Views
from rearticulate.parts.relaxed import Relaxed
from rearticulate.progress import Told, steps, untold

# Chi-squares are per degree of freedom.
JOINT_RMS = 0.25  # spacings; one joint is enough when its misfit is below this
GAIN = 0.2  # another joint in series must lower the chi-square to this share
SMALL_RMS = 0.5  # spacings; misfits below this need the stricter gain
SMALL_GAIN = 0.05
GAP_SERIES = 4.0  # spacings; two joints in series are tried for parts nearer than this, hidden or not
GAP_WEIGHT = 0.35
BETWEEN = 8  # places in a gap that are looked at
UNSEEN = 0.06  # weight of a gap that is hidden: the parts may touch there
SERIES_COST = 2.0  # what a second joint costs in the spanning tree
OFF_ROOT = 1.2  # what a joint between two moving parts costs more than one on the root
LINK_NEAR = 4.0  # spacings; a hidden link starts with the points of the part that hangs on it within this reach
LINK_FAR = 12.0  # ... or within this one
LINK_SHARE = 0.4  # ... but with at most this share of them
SMALL_PART = 0.04  # share of the points below which a part may become a link of a chain


def part_gaps(
    evidence: Evidence, P: int, rng: np.random.Generator, told: Told = untold, sample: int = 2000
) -> tuple[Float[Array, "P P"], Float[Array, "P P"]]:
    """Mean over the frames of the smallest distances between two parts (mean of three), and the same as far as what
    lies between them is not hidden."""
    z = [evidence.fused.z[evidence.fused.labels == p] for p in range(P)]
    z = [x if len(x) <= sample else rng.choice(x, sample, replace=False) for x in z]
    trees = [search_tree(x) for x in z]
    T = evidence.T
    gap, open_gap = np.zeros((2, P, P))
    for p in range(P):
        for q in range(p):
            moved = transform((inverse(T[:, q]) @ T[:, p])[:, None], z[p])
            distance, row = nearest(trees[q], moved.reshape(-1, 3))
            d = distance.reshape(len(T), -1)
            closest = np.partition(d, min(2, d.shape[1] - 1), axis=1)[:, :3]
            gap[p, q] = gap[q, p] = open_gap[p, q] = open_gap[q, p] = closest.mean()
            if evidence.views is not None:
                f, i = np.arange(len(T)), d.argmin(axis=1)
                ends = np.stack([moved[f, i], z[q][row.reshape(d.shape)[f, i]]], axis=1)
                share = open_share(evidence.views, transform(T[:, q, None], ends))
                open_gap[p, q] = open_gap[q, p] = (share * closest.mean(axis=1)).mean()
        told((p + 1) / P)
    return gap, open_gap


def open_share(views: Views, ends: Float[Array, "F 2 3"]) -> Float[Array, " F"]:
    """Weight of a gap between two places in each frame: 1 where nothing hides it, `UNSEEN` where all of it is
    hidden."""
    F, share = len(ends), (np.arange(BETWEEN) + 0.5)[:, None] / BETWEEN
    y = (1 - share) * ends[:, None, 0] + share * ends[:, None, 1]
    found = views.classes(y.reshape(-1, 3), np.repeat(np.arange(F), BETWEEN)).reshape(F, BETWEEN)
    return 1 - (1 - UNSEEN) * (found == HIDDEN).mean(axis=1)


@dataclass(frozen=True)
class Joints:
    """One joint for each of B pairs (a moves against b). other_cost: the cost of the other type."""

    twist: Float[Array, "B 6"]
    q: Float[Array, "B F"]
    revolute: Bool[Array, " B"]
    cost: Float[Array, " B"]
    other_cost: Float[Array, " B"]
    W: Float[Array, "B F 6 6"]


def fit_joints(evidence: Evidence, a: Int[Array, " B"], b: Int[Array, " B"], slide_margin: float) -> Joints:
    """The better of a revolute and a prismatic joint for every pair; a slide is preferred while a turn is not
    better by slide_margin in chi-square."""
    A, W = relative_motion(evidence.T, evidence.H, a, b, evidence.canonical)
    turn = fit_revolute(A, W, evidence.canonical)
    centre = np.stack([evidence.fused.z[evidence.fused.labels == p].mean(axis=0) for p in a])
    slide = fit_prismatic(A, W, centre, evidence.canonical)
    sliding = (slide.cost - turn.cost) / evidence.sigma**2 < slide_margin
    return Joints(
        twist=np.where(sliding[:, None], slide.twist[:, 0], turn.twist[:, 0]),
        q=np.where(sliding[:, None], slide.q[..., 0], turn.q[..., 0]),
        revolute=~sliding,
        cost=np.where(sliding, slide.cost, turn.cost),
        other_cost=np.where(sliding, turn.cost, slide.cost),
        W=W,
    )


def tree_costs(
    evidence: Evidence, P: int, root: int, config: FitConfig, rng: np.random.Generator, told: Told = untold
) -> Float[Array, "P P"]:
    """Cost of joining two parts: log(1 + X_1), or with a hidden link series_cost + log(1 + X_2); plus the gap.

    Two drawers, or two doors on one hinge line, move against each other by one joint as well: a pair without the root
    costs a little more.
    """
    distance, gap = part_gaps(evidence, P, rng, told)
    cost = np.zeros((P, P))
    a, b = np.tril_indices(P, -1)
    one = evidence.reduced(fit_joints(evidence, a, b, config.slide_margin).cost, 1)
    best = np.log1p(one)
    series = np.flatnonzero((one > config.joint_chi2) & (distance[a, b] < GAP_SERIES))
    if len(series) and config.uses("hidden links"):
        A, W = relative_motion(evidence.T, evidence.H, a[series], b[series], evidence.canonical)
        contact = np.stack([contact_point(evidence, int(p), int(q)) for p, q in zip(a[series], b[series], strict=True)])
        two = evidence.reduced(fit_series(A, W, contact, 2, evidence.canonical, starts=3).cost, 2)
        best[series] = np.minimum(best[series], SERIES_COST + np.log1p(two))
    off_root = np.where((a == root) | (b == root), 0.0, OFF_ROOT)
    cost[a, b] = cost[b, a] = best + GAP_WEIGHT * gap[a, b] + off_root
    return cost


def _series_test(
    evidence: Evidence, a: int, b: int, contact: Float[Array, " 3"], k: int, starts: int = 6
) -> tuple[float, ChainFit]:
    A, W = relative_motion(evidence.T, evidence.H, np.array([a]), np.array([b]), evidence.canonical)
    fit = fit_series(A, W, contact[None], k, evidence.canonical, starts)
    return float(evidence.reduced(fit.cost, k)[0]), fit.take(0)


def hidden_links(
    evidence: Evidence, a: int, b: int, x1: float, rms: float, joint_chi2: float
) -> tuple[ChainFit | None, Float[Array, " 3"]]:
    """Two or three joints in series between a and b when one does not do (chi-square x1) and they do."""
    contact = contact_point(evidence, a, b)
    if x1 < joint_chi2 or rms < JOINT_RMS:
        return None, contact
    x2, two = _series_test(evidence, a, b, contact, 2)
    if rms < SMALL_RMS and not (x2 < SMALL_GAIN * x1 and x2 < 0.5):
        return None, contact
    if x2 >= joint_chi2:
        x3, three = _series_test(evidence, a, b, contact, 3)
        if x3 < GAIN * min(x2, x1):
            return three, contact
    return (two if x2 < GAIN * x1 else None), contact


def near_contact(
    z: Float[Array, "M 3"], contact: Float[Array, " 3"], inside: Bool[Array, " M"], reach: float, share: float
) -> Bool[Array, " M"]:
    """The points of a part that a hidden link starts with: near the contact, and at most a share of the part."""
    d = np.linalg.norm(z - contact, axis=1)
    return inside & (d < min(reach, float(np.quantile(d[inside], share))))


def project(
    frames: Frames,
    canonical: int,
    model: Relaxed,
    config: FitConfig,
    rng: np.random.Generator,
    told: Told = untold,
) -> Projection:
    """The tree of joints of the relaxed model."""
    evidence = gather_evidence(frames, canonical, model)
    P = model.n_parts
    root = choose_root(frames, canonical, model)
    if P == 1:
        return Projection(assemble([], model.T[:, root], root, 1)[0], (np.zeros_like(model.labels),), np.arange(0))
    pairs, chains = steps(told, 2)
    parent, order = spanning_tree(tree_costs(evidence, P, root, config, rng, pairs), root)
    child = order[1:]
    joints = fit_joints(evidence, child, parent[child], config.slide_margin)
    x1, rms = evidence.reduced(joints.cost, 1), evidence.rms(joints.cost, joints.W)
    links = {
        int(c): Link(int(c), int(parent[c]), joints.twist[i], joints.q[i], bool(joints.revolute[i]))
        for i, c in enumerate(child)
    }
    x = {int(c): float(x1[i]) for i, c in enumerate(child)}
    r = {int(c): float(rms[i]) for i, c in enumerate(child)}
    if config.uses("small middles"):
        _replace_small_middles(evidence, model, links, x, config.joint_chi2)
    n_links = P
    reaches = (LINK_NEAR, LINK_FAR)
    starts = [model.labels.copy() for _ in reaches]
    hanging = [int(c) for c in child] if config.uses("hidden links") else []
    for c, each in zip(hanging, steps(chains, len(hanging)), strict=True):
        each(0.0)
        link = links[c]
        chain, contact = hidden_links(evidence, c, link.parent, x[c], r[c], config.joint_chi2)
        if chain is None:
            continue
        k = chain.twist.shape[0]
        if n_links + k - 1 > P + config.max_hidden:
            break
        for labels, reach in zip(starts, reaches, strict=True):
            near = near_contact(evidence.fused.z, contact, model.labels == c, reach, LINK_SHARE)
            labels[near] = n_links + k - 2
        above = link.parent
        for i in range(k - 1):
            links[n_links] = Link(n_links, above, chain.twist[i], chain.q[:, i], True)
            above = n_links
            n_links += 1
        links[c] = Link(c, above, chain.twist[k - 1], chain.q[:, k - 1], True)
    tree, number = assemble(list(links.values()), model.T[:, root], root, n_links)
    tree, _ = adjust_to_poses(tree, canonical, number[:P], model.T, evidence.H)
    if n_links == P:
        starts = starts[:1]
    return Projection(tree, tuple(number[labels] for labels in starts), number[P:])


def _replace_small_middles(
    evidence: Evidence, model: Relaxed, links: dict[int, Link], x: dict[int, float], joint_chi2: float
) -> None:
    """A small part whose two joints both fail becomes the middle link of a two-joint chain between its neighbours."""
    counts = model.counts()
    for v in sorted(links, key=lambda p: counts[p]):
        children = [c for c in links if links[c].parent == v]
        if len(children) != 1 or counts[v] > SMALL_PART * counts.sum():
            continue
        a, b = children[0], links[v].parent
        if x[a] < joint_chi2 or x[v] < joint_chi2:
            continue
        contact = (contact_point(evidence, a, v) + contact_point(evidence, v, b)) / 2
        x2, two = _series_test(evidence, a, b, contact, 2)
        if x2 < joint_chi2 and x2 < GAIN * (x[a] + x[v]):
            links[v] = Link(v, b, two.twist[0], two.q[:, 0], True)
            links[a] = Link(a, v, two.twist[1], two.q[:, 1], True)
            x[v] = x[a] = x2
