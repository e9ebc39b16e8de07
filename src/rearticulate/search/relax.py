"""First half of the solver: from raw clouds to rigid parts that move freely (the paper's relaxed model)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rearticulate.config import FitConfig
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import surface_noise
from rearticulate.observe.register import Schedule
from rearticulate.parts.bodies import make_bodies, to_relaxed
from rearticulate.parts.cluster import cluster
from rearticulate.parts.labels import Labeller
from rearticulate.parts.patches import track_patches
from rearticulate.parts.relaxed import (
    Relaxed,
    drop_small,
    largest_parts,
    register_to_frames,
    register_to_fused,
    spread_labels,
)
from rearticulate.parts.repair import repair_poses
from rearticulate.parts.rest import part_at_rest
from rearticulate.parts.trial import trial_merge
from rearticulate.progress import steps
from rearticulate.search.explain import explain

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

WIDE = Schedule(iterations=8, sigma=1.5, sigma_end=0.56, point_share=0.05, max_distance=5.6)
FIRST_THRESHOLD = 0.03  # as `FitConfig.merge_threshold`, while the motions are rough
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
    tracks = track_patches(frames, canonical, config, lambda done: progress("track", done))
    labels, T = cluster(tracks, config.fragment_penalty, config.max_fragments)
    model = Relaxed(T, spread_labels(frames, canonical, T, labels))
    step = steps(lambda done: progress("segment", done), 13)
    model = register_to_frames(frames, canonical, model, WIDE, next(step))
    model = trial_merge(frames, canonical, model, FIRST_THRESHOLD, rng, next(step))
    found, model = model.n_parts, largest_parts(frames, model, config.max_parts)
    if config.uses("pose repair"):
        model = repair_poses(frames, canonical, model, rng, told=next(step))
    if config.uses("part at rest"):
        model = part_at_rest(frames, canonical, model)
    for _ in range(2):
        model = register_to_frames(frames, canonical, model, NARROW, next(step))
        model = labeller.coarse(register_to_fused(frames, canonical, model), config.minimum_points, next(step))
    model = trial_merge(frames, canonical, model, config.merge_threshold, rng, next(step))
    if config.uses("pose repair"):
        model = repair_poses(frames, canonical, model, rng, told=next(step))
    belief = None
    labeller = labeller.with_noise(surface_noise(frames, canonical, model.T, model.labels))
    for i in range(2):
        model, belief = labeller.fine(register_to_fused(frames, canonical, model, 0.47), belief, next(step))
        before = model.n_parts
        model = drop_small(frames, model, config.minimum_points / 2)
        if i == 0:
            model = trial_merge(frames, canonical, model, config.merge_threshold, rng, next(step))
        belief = belief if model.n_parts == before else None
    if found <= config.max_parts:
        start = make_bodies(frames, model.T, model.labels)
        model = to_relaxed(explain(frames, canonical, start, config, told=next(step))[0], len(model.labels))
    progress("segment", 1.0)
    return replace(model, found=found)
