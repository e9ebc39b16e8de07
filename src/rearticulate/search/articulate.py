"""Second half of the solver: from freely moving parts to a kinematic tree, adjusted to all points at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rearticulate.config import FitConfig
from rearticulate.joints.articulated import Articulated
from rearticulate.joints.bundle import SIGMA, SIGMA_WIDE, bundle_adjust, last_sigma
from rearticulate.joints.joint_repair import repair_joints
from rearticulate.joints.project import merge_resting, project
from rearticulate.joints.seams import cut_seams
from rearticulate.joints.simplify import simplify
from rearticulate.joints.tree import Projection
from rearticulate.observe.energy import energy, point_misfit
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import surface_noise
from rearticulate.parts.labels import Labeller
from rearticulate.parts.relaxed import Relaxed, drop_small, largest_parts, register_to_fused
from rearticulate.parts.repair import repair_poses
from rearticulate.parts.trial import trial_merge
from rearticulate.progress import Told, steps, untold

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

HYPOTHESES = 3  # of the structure, at most
FIRST_ROUNDS, MORE_ROUNDS = 2, 2  # of labels and motions, at most: from every start, and from the better one
SETTLED = 0.015  # share of points that change their label in the last round
WORTH = 2e-3  # a hypothesis that lowers the energy by less is the last


def articulate(
    frames: Frames,
    canonical: int,
    relaxed: Relaxed,
    labeller: Labeller,
    config: FitConfig,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
) -> tuple[Articulated, IntArray]:
    """Tree, bundle adjustment, labels and repairs in turn; then a new hypothesis of the structure, as long as that is
    another one and lowers the energy. The one with the lowest energy is kept. Where more parts were found than can be
    worked with, the first is the last: there is no structure to be found.

    Returns the model and the labels (M,) of all points.
    """
    labeller = labeller.with_noise(surface_noise(frames, canonical, relaxed.T, relaxed.labels))
    first, *tries, last = steps(lambda done: progress("articulate", done), HYPOTHESES + 2)
    model = merge_resting(frames, canonical, relaxed, config.rest_chi2)
    start = project(frames, canonical, model, config, rng, first)
    best, lowest = None, np.inf
    only_one = relaxed.found > config.max_parts or not config.uses("second look")
    for one_try in tries[:1] if only_one else tries:
        structure, motion = steps(one_try, 2)
        if best is not None:
            start = restructure(frames, canonical, best.tree, best.labels, relaxed, config, rng, structure)
            if same_structure(start, best):
                break
        new, value = adjust(frames, canonical, start, labeller, config, rng, motion)
        gain = lowest - value
        if gain > 0:
            best, lowest = new, value
        if gain < WORTH:
            break
    assert best is not None
    tree = best.tree
    step = steps(last, 3)
    parts, belief = labeller.fine(Relaxed(tree.forward(), best.labels), None, next(step))
    parts, _ = labeller.fine(parts, belief, next(step))
    labels = parts.labels
    if config.uses("seams"):
        labels = cut_seams(frames, tree, labels, labeller.thickness)
    fine = last_sigma(surface_noise(frames, canonical, tree.forward(), labels))
    tree = bundle_adjust(frames, canonical, tree, labels, (SIGMA, fine, fine), True, told=next(step))
    progress("articulate", 1.0)
    return tree, labels


@dataclass(frozen=True)
class Hypothesis:
    """One structure with its motions and the labels (M,) of all points; belief (M, P) of the last labels."""

    tree: Articulated
    labels: IntArray
    belief: Array | None = None

    def energy(self, frames: Frames) -> float:
        return energy(frames, self.tree.forward(), self.labels)


def same_structure(start: Projection, hypothesis: Hypothesis) -> bool:
    """Is this the tree of the hypothesis again, part by part (those that share most points) and joint by joint?"""
    tree, P = start.tree, hypothesis.tree.n_parts
    if len(start.hidden) or tree.n_parts != P:
        return False
    match = np.bincount(start.starts[0] * P + hypothesis.labels, minlength=P * P).reshape(P, P).argmax(axis=1)
    return (
        len(np.unique(match)) == P
        and match[0] == 0
        and np.array_equal(match[tree.parent[1:]], hypothesis.tree.parent[match[1:]])
        and np.array_equal(tree.revolute, hypothesis.tree.revolute[match])
    )


def adjust(
    frames: Frames,
    canonical: int,
    start: Projection,
    labeller: Labeller,
    config: FitConfig,
    rng: np.random.Generator,
    told: Told = untold,
) -> tuple[Hypothesis, float]:
    """Motions and labels in turn under a given structure, from the better of its starts; frames that were lost are
    repaired in joint space, and joints that nothing needs go. Returns the hypothesis and its energy."""
    hypotheses, step = [], steps(told, 2 * len(start.starts) + 4)
    for labels in start.starts:
        tree = bundle_adjust(frames, canonical, start.tree, labels, (SIGMA_WIDE, SIGMA), told=next(step))
        hypotheses.append(
            alternate(frames, canonical, Hypothesis(tree, labels), labeller, config, FIRST_ROUNDS, next(step))
        )
    hypothesis = hypotheses[0] if len(hypotheses) == 1 else best_of_both(frames, hypotheses, start.hidden)
    hypothesis = alternate(frames, canonical, hypothesis, labeller, config, MORE_ROUNDS, next(step))
    tree, labels = hypothesis.tree, hypothesis.labels
    if config.uses("joint repair"):
        tree, _ = repair_joints(frames, canonical, tree, labels, rng, next(step))
    tree = bundle_adjust(frames, canonical, tree, labels, (SIGMA,), told=next(step))
    if not config.uses("simplify"):
        return Hypothesis(tree, labels), energy(frames, tree.forward(), labels)
    tree, labels, value = simplify(frames, canonical, tree, labels, next(step))
    return Hypothesis(tree, labels), value


def best_of_both(frames: Frames, hypotheses: list[Hypothesis], hidden: IntArray) -> Hypothesis:
    """The hypothesis with the lowest energy, in which every hidden link and what hangs on it come from the one that
    explains their points best."""
    best = min(hypotheses, key=lambda k: k.energy(frames))
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
    return Hypothesis(replace(best.tree, twist=twist, q=q), labels)


def alternate(
    frames: Frames,
    canonical: int,
    hypothesis: Hypothesis,
    labeller: Labeller,
    config: FitConfig,
    rounds: int,
    told: Told = untold,
) -> Hypothesis:
    """Labels and motions in turn, until few labels change."""
    for each_round in steps(told, rounds):
        label, adjustment = steps(each_round, 2)
        parts, belief = labeller.fine(Relaxed(hypothesis.tree.forward(), hypothesis.labels), hypothesis.belief, label)
        changed = np.mean(parts.labels != hypothesis.labels)
        labels = parts.labels
        if config.uses("seams"):
            labels = cut_seams(frames, hypothesis.tree, labels, labeller.thickness, only_empty=True)
        hypothesis = Hypothesis(
            bundle_adjust(frames, canonical, hypothesis.tree, labels, (SIGMA,), told=adjustment), labels, belief
        )
        if changed < SETTLED:
            break
    return hypothesis


def restructure(
    frames: Frames,
    canonical: int,
    tree: Articulated,
    labels: IntArray,
    relaxed: Relaxed,
    config: FitConfig,
    rng: np.random.Generator,
    told: Told = untold,
) -> Projection:
    """A new hypothesis from accurate motions: links without points go, parts move freely, the tree is built anew."""
    model = drop_small(frames, Relaxed(tree.forward(), labels), config.minimum_support)
    model = largest_parts(frames, model, config.max_parts)
    rows = frames.rows(canonical)
    shared = np.zeros((model.n_parts, relaxed.n_parts))
    np.add.at(shared, (model.labels[rows], relaxed.labels[rows]), 1)
    earlier = {p: [relaxed.T[:, int(shared[p].argmax())]] for p in range(model.n_parts) if shared[p].any()}
    step = steps(told, 3)
    if config.uses("pose repair of the second look"):
        model = repair_poses(frames, canonical, model, rng, earlier, False, next(step))
    model = register_to_fused(frames, canonical, model, 0.37)
    model = trial_merge(frames, canonical, model, config.merge_threshold, rng, next(step))
    model = merge_resting(frames, canonical, model, config.rest_chi2)
    return project(frames, canonical, model, config, rng, next(step))
