"""The observed scene flow of a sequence: from the correspondence network, or from the direct solver's tracking."""

from __future__ import annotations

from itertools import pairwise

from rearticulate.config import FitConfig
from rearticulate.fit.flow import SceneFlow
from rearticulate.fit.frames import Frames
from rearticulate.fit.track import track
from rearticulate.geometry.se3 import transform
from rearticulate.network.correspond import match_sequence
from rearticulate.network.inference import load_network


def network_flow(frames: Frames, ratio: float) -> tuple[SceneFlow, ...]:
    """Mutual matches of the shipped network between successive frames (supplement, "Flow Prediction Network")."""
    clouds = [frames.points[frames.rows(f)] for f in range(frames.n_frames)]
    matches = match_sequence(load_network(), clouds, ratio)
    return tuple(SceneFlow(a[i], b[j] - a[i]) for (a, b), (i, j) in zip(pairwise(clouds), matches, strict=True))


def tracked_flow(frames: Frames, canonical: int, config: FitConfig) -> tuple[SceneFlow, ...]:
    """Steps of the canonical points, carried by their patches."""
    tracks = track(frames, canonical, config.track, lambda done: None)
    moved = transform(tracks.T[:, tracks.patches.owner], frames.points[frames.rows(canonical)])
    return tuple(SceneFlow(a, b - a) for a, b in pairwise(moved))


def observed_flow(frames: Frames, canonical: int, config: FitConfig) -> tuple[SceneFlow, ...]:
    """One record a pair of neighbouring frames, from the configured source."""
    if config.neural.observed == "tracking":
        return tracked_flow(frames, canonical, config)
    return network_flow(frames, config.neural.ratio)
