"""First half of the solver: from raw clouds to rigid parts that move freely (the paper's relaxed model)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rearticulate.config import FitConfig
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import Schedule
from rearticulate.parts.bodies import make_bodies, to_relaxed
from rearticulate.parts.cluster import cluster
from rearticulate.parts.patches import track_patches
from rearticulate.parts.relaxed import (
    Relaxed,
    largest_parts,
    register_to_frames,
    spread_labels,
)
from rearticulate.parts.repair import repair_poses
from rearticulate.parts.trial import trial_merge
from rearticulate.progress import steps
from rearticulate.search.explain import explain

WIDE = Schedule(iterations=8, sigma=1.5, sigma_end=0.56, point_share=0.05, max_distance=5.6)


def relax(
    frames: Frames,
    canonical: int,
    config: FitConfig,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
) -> Relaxed:
    """Track, over-segment, merge by trial, restart what was lost; then the bodies of the lowest score."""
    tracks = track_patches(frames, canonical, config, lambda done: progress("track", done))
    labels, T = cluster(tracks, config.fragment_penalty, config.max_fragments)
    model = Relaxed(T, spread_labels(frames, canonical, T, labels))
    rough, trial, restart, search = steps(lambda done: progress("segment", done), 4)
    model = register_to_frames(frames, canonical, model, WIDE, rough)
    model = trial_merge(frames, canonical, model, config.merge_threshold, rng, trial)
    found, model = model.n_parts, largest_parts(frames, model, config.max_parts)
    if config.uses("restart"):
        model = repair_poses(frames, canonical, model, rng, told=restart)
    if found <= config.max_parts:
        start = make_bodies(frames, model.T, model.labels)
        model = to_relaxed(explain(frames, canonical, start, config, told=search), len(model.labels))
    progress("segment", 1.0)
    return replace(model, found=found)
