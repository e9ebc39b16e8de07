"""First half of the solver: from raw clouds to rigid parts that move freely (the paper's relaxed model)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from rearticulate.config import FitConfig, RestConfig
from rearticulate.geometry.nearest import nearest
from rearticulate.solver.cluster import cluster
from rearticulate.solver.frames import Frames
from rearticulate.solver.labels import Labeller
from rearticulate.solver.progress import steps
from rearticulate.solver.register import Schedule
from rearticulate.solver.relaxed import (
    Relaxed,
    drop_small,
    largest_parts,
    register_to_frames,
    register_to_fused,
    spread_labels,
    surface_noise,
)
from rearticulate.solver.repair import repair_poses
from rearticulate.solver.track import track
from rearticulate.solver.trial import Trials, trial_merge

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

WIDE = Schedule(iterations=8, sigma=1.5, sigma_end=0.56, point_share=0.05, max_distance=5.6)
NARROW = Schedule(iterations=8, sigma=0.93, sigma_end=0.37, point_share=0.05, max_distance=5.6)


def relax(
    frames: Frames,
    canonical: int,
    labeller: Labeller,
    config: FitConfig,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
) -> Relaxed:
    """Track, over-segment, merge by trial, repair, label; twice coarsely and twice by sheets, all before any tree."""
    tracks = track(frames, canonical, config.track, lambda done: progress("track", done))
    labels, T = cluster(tracks, config.cluster)
    model = Relaxed(T, spread_labels(frames, canonical, T, labels))
    step = steps(lambda done: progress("segment", done), 12)
    model = register_to_frames(frames, canonical, model, WIDE, next(step))
    model = trial_merge(frames, canonical, model, config.trial, config.trial.threshold_first, rng, next(step))
    found, model = model.n_parts, largest_parts(frames, model, config.max_parts)
    model = repair_poses(frames, canonical, model, config.repair, rng, told=next(step))
    model = part_at_rest(frames, canonical, model, config.rest)
    for _ in range(2):
        model = register_to_frames(frames, canonical, model, NARROW, next(step))
        model = labeller.coarse(register_to_fused(frames, canonical, model), config.label.candidate_radius, next(step))
    model = trial_merge(frames, canonical, model, config.trial, config.trial.threshold, rng, next(step))
    model = repair_poses(frames, canonical, model, config.repair, rng, told=next(step))
    belief = None
    labeller = labeller.with_noise(surface_noise(frames, canonical, model.T, model.labels))
    for i in range(2):
        model, belief = labeller.fine(register_to_fused(frames, canonical, model, 0.47), belief, next(step))
        before = model.n_parts
        model = drop_small(frames, model, config.label.minimum_points / 2)
        if i == 0:
            model = trial_merge(frames, canonical, model, config.trial, config.trial.threshold, rng, next(step))
        belief = belief if model.n_parts == before else None
    progress("segment", 1.0)
    return replace(register_to_fused(frames, canonical, model), found=found)


def part_at_rest(frames: Frames, canonical: int, model: Relaxed, config: RestConfig) -> Relaxed:
    """When every part moves, the points that standing still explains as well become a part of their own.

    A body of revolution that carries a turning link is dragged along by it, for nothing in its motion says otherwise.
    """
    trials = Trials(frames, canonical, np.random.default_rng(0))
    labels = model.labels[frames.rows(canonical)]
    travel = np.linalg.norm(model.moved_points(frames, canonical) - trials.x, axis=-1).mean(axis=0)
    counts = np.bincount(labels, minlength=model.n_parts)
    mean = np.bincount(labels, travel, minlength=model.n_parts) / np.maximum(counts, 1)
    if mean[counts > config.minimum_part].min(initial=np.inf) < config.motion:
        return model
    everyone, still = np.arange(len(labels)), np.eye(4)[None]
    excess = np.mean(
        [
            trials.cost(f, everyone, np.zeros_like(labels), still) - trials.cost(f, everyone, labels, model.T[f])
            for f in trials.others
        ],
        axis=0,
    )
    tree = frames.trees[canonical]
    calm = excess[nearest(tree, tree.data, k=min(30, tree.n))[1]].mean(axis=1) < config.excess
    chosen = largest_region(trials.x, trials.near[:, :8], calm)
    if chosen.sum() < config.minimum_points or travel[chosen].mean() < config.carried:
        return model
    T = np.concatenate([model.T, np.tile(np.eye(4), (len(model.T), 1, 1, 1))], axis=1)
    labels = np.where(chosen, model.n_parts, labels)
    return Relaxed(T, spread_labels(frames, canonical, T, labels))


def largest_region(points: Array, near: IntArray, inside: NDArray[np.bool_], reach: float = 4.0) -> NDArray[np.bool_]:
    """(N,) the largest connected set of the points inside (N,): neighbours near (N, K) within reach are connected."""
    gap = np.linalg.norm(points[near] - points[:, None], axis=-1)
    a, k = np.nonzero(inside[:, None] & inside[near] & (gap < reach))
    graph = coo_matrix((np.ones(len(a)), (a, near[a, k])), shape=(len(points), len(points)))
    region = connected_components(graph, directed=False)[1]
    return inside & (region == np.bincount(region[inside], minlength=1).argmax())
