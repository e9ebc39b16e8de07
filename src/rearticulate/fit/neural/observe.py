"""The observed scene flow of a sequence: from the correspondence network, or from the direct solver's tracking."""

from __future__ import annotations

from itertools import pairwise

from rearticulate.config import FitConfig, NeuralConfig
from rearticulate.fit.flow import SceneFlow
from rearticulate.fit.frames import Frames
from rearticulate.fit.guided import guided_flow, matched_flow
from rearticulate.fit.track import track
from rearticulate.geometry.se3 import transform
from rearticulate.network.correspond import sequence_features
from rearticulate.network.inference import load_network


def network_flow(frames: Frames, config: NeuralConfig) -> tuple[SceneFlow, ...]:
    """Matches of the shipped network between successive frames (supplement, "Flow Prediction Network")."""
    clouds = [frames.points[frames.rows(f)] for f in range(frames.n_frames)]
    features = sequence_features(load_network(), clouds)
    pairs = zip(pairwise(clouds), pairwise(features), strict=True)
    if config.guided:
        return tuple(guided_flow(a, b, of_both) for (a, b), of_both in pairs)
    return tuple(matched_flow(a, b, of_both, config.ratio) for (a, b), of_both in pairs)


def tracked_flow(frames: Frames, canonical: int, config: FitConfig) -> tuple[SceneFlow, ...]:
    """Steps of the canonical points, carried by their patches."""
    tracks = track(frames, canonical, config.track, lambda done: None)
    moved = transform(tracks.T[:, tracks.patches.owner], frames.points[frames.rows(canonical)])
    return tuple(SceneFlow(a, b - a) for a, b in pairwise(moved))


def observed_flow(frames: Frames, canonical: int, config: FitConfig) -> tuple[SceneFlow, ...]:
    """One record a pair of neighbouring frames, from the configured source."""
    if config.neural.observed == "tracking":
        return tracked_flow(frames, canonical, config)
    return network_flow(frames, config.neural)
