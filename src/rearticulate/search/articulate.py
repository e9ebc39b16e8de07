"""Second half of the solver: from freely moving parts to a kinematic tree, adjusted to all points at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rearticulate.arrays import Array, Int
from rearticulate.config import FitConfig
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.bundle import SIGMA, SIGMA_WIDE, adjust_to_poses, bundle_adjust, last_sigma
from rearticulate.joints.project import project
from rearticulate.joints.seams import cut_seams
from rearticulate.joints.simplify import poses_of, simplify
from rearticulate.joints.tree import Projection
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import surface_noise
from rearticulate.observe.misfit import point_misfit
from rearticulate.parts.bodies import (
    Bodies,
    Explanation,
    explanation,
    labels_of,
    make_bodies,
    score,
    to_relaxed,
    without_crumbs,
)
from rearticulate.parts.ownership import exchange, relabel
from rearticulate.parts.relaxed import Relaxed
from rearticulate.parts.repair import repair_poses
from rearticulate.parts.sheets import sheet_thickness
from rearticulate.progress import Told, steps, untold
from rearticulate.search.explain import explain
from rearticulate.search.moves.combine import combine_bodies

HYPOTHESES = 2  # of the structure, at most
FIRST_ROUNDS, MORE_ROUNDS = 2, 2  # of labels and motions, at most: from every start, and from the better one
LAST_ROUNDS = 2  # of labels by own-part evidence and motions by all points
SETTLED = 0.015  # share of points that change their label in the last round
WORTH = 2e-3  # share of the score; a hypothesis that lowers it by less is the last


def articulate(
    frames: Frames,
    canonical: int,
    relaxed: Relaxed,
    others: Sequence[Relaxed],
    config: FitConfig,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
) -> tuple[Articulated, Int[Array, " M"]]:
    """Tree, bundle adjustment, labels and repairs in turn; then a new hypothesis of the structure, as long as that is
    another one and lowers the score. The one with the lowest score is kept. Where more parts were found than can be
    worked with, the first is the last: there is no structure to be found.

    Returns the model and the labels of all points.
    """
    thickness = sheet_thickness(surface_noise(frames, canonical, relaxed.T, relaxed.labels))
    first, *tries, last = steps(lambda done: progress("articulate", done), HYPOTHESES + 2)
    combined, projected = steps(first, 2)
    bodies = make_bodies(frames, relaxed.T, relaxed.labels)
    if others and relaxed.found <= config.max_parts and config.uses("other starts"):
        more = combine_bodies(frames, canonical, bodies, others)
        if more is not bodies:
            bodies = explain(frames, canonical, more, config, bodies, combined)
    start = project(frames, canonical, to_relaxed(bodies, len(relaxed.labels)), config, rng, projected)
    best, lowest, tried = None, None, ()
    only_one = relaxed.found > config.max_parts or not config.uses("second look")
    for one_try in tries[:1] if only_one else tries:
        structure, motion = steps(one_try, 2)
        if best is not None:
            tried, start = restructure(frames, canonical, best, tried, config, rng, structure)
            if same_structure(start, best):
                break
        new, value = adjust(frames, canonical, start, thickness, config, rng, motion)
        gain = -value.over(lowest)
        if gain > 0:
            best, lowest = new, value
        if gain < WORTH * value.score:
            break
    assert best is not None
    tree, bodies, labels, fine = best.tree, best.bodies, best.labels, last_sigma(frames.noise)
    if config.uses("seams"):
        labels = cut_seams(frames, tree, labels, thickness)
    for each_round in steps(last, LAST_ROUNDS):
        label, adjustment = steps(each_round, 2)
        bodies = own_labels(frames, make_bodies(frames, tree.forward(), labels, bodies), config, label)
        labels = labels_of(bodies, len(labels))
        if config.uses("seams"):
            labels = cut_seams(frames, tree, labels, thickness)
        tree, bodies = bundle_adjust(frames, canonical, tree, labels, (SIGMA, fine, fine), bodies, adjustment)
    progress("articulate", 1.0)
    return tree, labels


def own_labels(frames: Frames, bodies: Bodies, config: FitConfig, told: Told = untold) -> Bodies:
    """The bodies with labels by own-part evidence under their motions."""
    points, layers = steps(told, 2)
    bodies = relabel(frames, bodies, told=points)
    return exchange(frames, bodies, told=layers) if config.uses("exchange") else bodies


@dataclass(frozen=True)
class Hypothesis:
    """One structure with its motions and the bodies of its parts."""

    tree: Articulated
    bodies: Bodies

    @cached_property
    def labels(self) -> Int[Array, " M"]:
        """(M,) of all points."""
        return labels_of(self.bodies, sum(len(body) for body in self.bodies))


def same_structure(start: Projection, hypothesis: Hypothesis) -> bool:
    """Is this the tree of the hypothesis again, part by part (those that share most points) and joint by joint?"""
    tree, P = start.tree, hypothesis.tree.n_parts
    if len(start.hidden) or tree.n_parts != P:
        return False
    match = np.bincount(start.starts[0] * P + hypothesis.labels, minlength=P * P).reshape(P, P).argmax(axis=1)
    return bool(
        len(np.unique(match)) == P
        and match[0] == 0
        and np.array_equal(match[tree.parent[1:]], hypothesis.tree.parent[match[1:]])
        and np.array_equal(tree.revolute, hypothesis.tree.revolute[match])
    )


def adjust(
    frames: Frames,
    canonical: int,
    start: Projection,
    thickness: float,
    config: FitConfig,
    rng: np.random.Generator,
    told: Told = untold,
) -> tuple[Hypothesis, Explanation]:
    """Motions and labels in turn under a given structure, from the better of its starts; parts that were
    lost start again, and joints that nothing needs go. Returns the hypothesis and what its score is made of."""
    hypotheses, step = [], steps(told, 2 * len(start.starts) + 4)
    for labels in start.starts:
        scales = (SIGMA_WIDE, SIGMA)
        found = Hypothesis(*bundle_adjust(frames, canonical, start.tree, labels, scales, told=next(step)))
        hypotheses.append(alternate(frames, canonical, found, thickness, config, FIRST_ROUNDS, next(step)))
    hypothesis = hypotheses[0] if len(hypotheses) == 1 else best_of_both(frames, hypotheses, start.hidden)
    hypothesis = alternate(frames, canonical, hypothesis, thickness, config, MORE_ROUNDS, next(step))
    tree, bodies, labels = hypothesis.tree, hypothesis.bodies, hypothesis.labels
    if config.uses("restart"):
        tree = restart(frames, canonical, hypothesis, rng, next(step))
    tree, bodies = bundle_adjust(frames, canonical, tree, labels, (SIGMA,), bodies, next(step))
    if not config.uses("simplify"):
        return Hypothesis(tree, bodies), explanation(frames, bodies)
    tree, bodies, value = simplify(frames, canonical, tree, bodies, next(step))
    return Hypothesis(tree, bodies), value


def restart(
    frames: Frames,
    canonical: int,
    hypothesis: Hypothesis,
    rng: np.random.Generator,
    told: Told = untold,
) -> Articulated:
    """Parts that lost their pose in a frame start again, each by itself; the tree follows them."""
    tree, now = hypothesis.tree, poses_of(hypothesis.bodies)
    T = repair_poses(frames, canonical, Relaxed(now.T, hypothesis.labels), rng, told).T
    return adjust_to_poses(tree, canonical, np.arange(tree.n_parts), T, now.H)[0]


def best_of_both(frames: Frames, hypotheses: list[Hypothesis], hidden: Int[Array, " h"]) -> Hypothesis:
    """The hypothesis with the lowest score, in which every hidden link and what hangs on it come from the one that
    explains their points best."""
    best = min(hypotheses, key=lambda k: score(frames, k.bodies))
    poses = [k.tree.forward() for k in hypotheses]
    twist, q, labels = best.tree.twist.copy(), best.tree.q.copy(), best.labels.copy()
    for v in hidden:
        links = np.append(v, np.flatnonzero(best.tree.parent == v))
        rows = np.flatnonzero(np.any([np.isin(k.labels, links) for k in hypotheses], axis=0))
        if len(rows) == 0:
            continue
        misfit = [point_misfit(frames, T, k.labels[rows], rows).mean() for k, T in zip(hypotheses, poses, strict=True)]
        chosen = hypotheses[int(np.argmin(misfit))]
        twist[links], q[:, links] = chosen.tree.twist[links], chosen.tree.q[:, links]
        labels[rows] = chosen.labels[rows]
    tree = replace(best.tree, twist=twist, q=q)
    return Hypothesis(tree, make_bodies(frames, tree.forward(), labels, best.bodies))


def alternate(
    frames: Frames,
    canonical: int,
    hypothesis: Hypothesis,
    thickness: float,
    config: FitConfig,
    rounds: int,
    told: Told = untold,
) -> Hypothesis:
    """Labels and motions in turn, until few labels change; links without points claim some."""
    for each_round in steps(told, rounds):
        label, adjustment = steps(each_round, 2)
        bodies = relabel(frames, hypothesis.bodies, 1, label)
        labels = labels_of(bodies, len(hypothesis.labels))
        changed = np.mean(labels != hypothesis.labels)
        if config.uses("seams"):
            labels = cut_seams(frames, hypothesis.tree, labels, thickness, only_empty=True)
        hypothesis = Hypothesis(
            *bundle_adjust(frames, canonical, hypothesis.tree, labels, (SIGMA,), bodies, adjustment)
        )
        if changed < SETTLED:
            break
    return hypothesis


def restructure(
    frames: Frames,
    canonical: int,
    hypothesis: Hypothesis,
    tried: Bodies,
    config: FitConfig,
    rng: np.random.Generator,
    told: Told = untold,
) -> tuple[Bodies, Projection]:
    """A new hypothesis from accurate motions: the parts move freely, what pays is merged and split, the tree is built
    anew. tried: the bodies of the last time."""
    searched, projected = steps(told, 2)
    start = without_crumbs(frames, hypothesis.bodies)
    bodies = explain(frames, canonical, start, config, tried, searched)
    return bodies, project(frames, canonical, to_relaxed(bodies, len(hypothesis.labels)), config, rng, projected)
