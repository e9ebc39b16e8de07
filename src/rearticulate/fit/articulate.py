"""Second half of the solver: from freely moving parts to a kinematic tree, adjusted to all points at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.config import FitConfig
from rearticulate.fit.articulated import Articulated
from rearticulate.fit.bundle import bundle_adjust
from rearticulate.fit.frames import Frames
from rearticulate.fit.joint_repair import repair_joints
from rearticulate.fit.labels import Labeller
from rearticulate.fit.energy import energy
from rearticulate.fit.project import Projection, merge_resting, project
from rearticulate.fit.relaxed import Relaxed, drop_small, register_to_fused
from rearticulate.fit.repair import repair_poses
from rearticulate.fit.seams import cut_seams
from rearticulate.fit.simplify import simplify
from rearticulate.fit.trial import trial_merge

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

LOOKS = 3
ROUNDS = 4  # of motions and labels, at most
SETTLED = 0.015  # share of points that change their label in the last round
WORTH = 2e-3  # a look that lowers the energy by less is the last
SIGMA_WIDE, SIGMA = 1.5, 0.56


def articulate(
    frames: Frames,
    canonical: int,
    relaxed: Relaxed,
    labeller: Labeller,
    config: FitConfig,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
) -> tuple[Articulated, IntArray]:
    """Tree, bundle adjustment, labels and repairs in turn; then a new look at the structure, until every joint passes
    its test. The look with the lowest energy is kept.

    Returns the model and the labels (M,) of all points.
    """
    model = merge_resting(frames, canonical, relaxed, config.project)
    start = project(frames, canonical, model, config.project, rng)
    best: Look | None = None
    for look in range(LOOKS):
        progress("articulate", look / LOOKS)
        if best is not None:
            start = restructure(frames, canonical, best.tree, best.labels, relaxed, config, rng)
        new = adjust(frames, canonical, start, labeller, config, rng)
        gain = np.inf if best is None else best.energy - new.energy
        best = new if gain > 0 else best
        if gain < WORTH:
            break
    assert best is not None
    tree = best.tree
    parts, belief = labeller.fine(Relaxed(tree.forward(), best.labels), None)
    parts, _ = labeller.fine(parts, belief)
    labels = cut_seams(frames, tree, parts.labels, config.label, config.seam)
    tree = bundle_adjust(frames, canonical, tree, labels, (SIGMA,), stride=1)
    progress("articulate", 1.0)
    return tree, labels


@dataclass(frozen=True)
class Look:
    """One structure, adjusted to the points: the tree, the labels (M,) and the energy."""

    tree: Articulated
    labels: IntArray
    energy: float


def adjust(
    frames: Frames,
    canonical: int,
    start: Projection,
    labeller: Labeller,
    config: FitConfig,
    rng: np.random.Generator,
) -> Look:
    """Motions and labels in turn under a given structure; lost frames are repaired in joint space."""
    looks = []
    for labels in start.starts:
        tree = bundle_adjust(frames, canonical, start.tree, labels, (SIGMA_WIDE, SIGMA))
        looks.append(alternate(frames, canonical, tree, labels, labeller, config, 2))
    look = looks[0] if len(looks) == 1 else min(looks, key=lambda k: energy(frames, k.tree.forward(), k.labels))
    look = alternate(frames, canonical, look.tree, look.labels, labeller, config, ROUNDS - 2, look.belief)
    tree, _ = repair_joints(frames, canonical, look.tree, look.labels, config.repair, rng)
    tree = bundle_adjust(frames, canonical, tree, look.labels, (SIGMA,))
    return Look(*simplify(frames, canonical, tree, look.labels, config.project))


@dataclass(frozen=True)
class Alternation:
    tree: Articulated
    labels: IntArray
    belief: Array | None


def alternate(
    frames: Frames,
    canonical: int,
    tree: Articulated,
    labels: IntArray,
    labeller: Labeller,
    config: FitConfig,
    rounds: int,
    belief: Array | None = None,
) -> Alternation:
    """Labels and motions in turn."""
    for _ in range(rounds):
        parts, belief = labeller.fine(Relaxed(tree.forward(), labels), belief)
        changed = np.mean(parts.labels != labels)
        labels = cut_seams(frames, tree, parts.labels, config.label, config.seam, only_empty=True)
        tree = bundle_adjust(frames, canonical, tree, labels, (SIGMA,))
        if changed < SETTLED:
            break
    return Alternation(tree, labels, belief)


def restructure(
    frames: Frames,
    canonical: int,
    tree: Articulated,
    labels: IntArray,
    relaxed: Relaxed,
    config: FitConfig,
    rng: np.random.Generator,
) -> Projection:
    """A second look with accurate motions: links without points go, parts move freely again, the tree is built anew."""
    model = drop_small(frames, Relaxed(tree.forward(), labels), config.label.minimum_support)
    rows = frames.rows(canonical)
    shared = np.zeros((model.n_parts, relaxed.n_parts))
    np.add.at(shared, (model.labels[rows], relaxed.labels[rows]), 1)
    earlier = {p: [relaxed.T[:, int(shared[p].argmax())]] for p in range(model.n_parts) if shared[p].any()}
    model = repair_poses(frames, canonical, model, config.repair, rng, earlier, turn=False)
    model = register_to_fused(frames, canonical, model, 0.37)
    model = trial_merge(frames, canonical, model, config.trial, config.trial.threshold, rng)
    model = merge_resting(frames, canonical, model, config.project)
    return project(frames, canonical, model, config.project, rng)
