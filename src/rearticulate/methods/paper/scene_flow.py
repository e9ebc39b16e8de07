"""The observed scene flow of a sequence, from the correspondence network (paper, sec. 3.2, supplement A.1).

Matches of features are off by some point spacings, more than many joints move from frame to frame. So they are only
the start of a registration of patches, the one that the direct solver tracks with.
"""

from __future__ import annotations

import numpy as np

from rearticulate.config import FitConfig
from rearticulate.geometry.se3 import transform
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import Frames
from rearticulate.parts.matched_starts import MatchedStarts
from rearticulate.parts.patches import make_patches, register_patches
from rearticulate.progress import Told, untold


def observed_flow(frames: Frames, config: FitConfig, told: Told = untold) -> tuple[SceneFlow, ...]:
    """One record a pair of successive frames."""
    matched, found = MatchedStarts(frames), []
    for f in range(frames.n_frames - 1):
        if config.neural.refined:
            found.append(registered_flow(frames, matched, f, config.capture_range))
        else:
            found.append(matched.flow(f, f + 1, config.neural.ratio))
        told((f + 1) / (frames.n_frames - 1))
    return tuple(found)


def registered_flow(frames: Frames, matched: MatchedStarts, f: int, capture_range: float) -> SceneFlow:
    """Flow of all points of a frame, by patches that are registered to the next frame from where matches lead them.

    From rest where a frame has too few points for the network.
    """
    rows = frames.rows(f)
    patches = make_patches(frames.points[rows], frames.normals[rows], f)
    start = np.tile(np.eye(4), (patches.count, 1, 1))
    if matched.possible(f, f + 1):
        start = matched.poses(start, patches.points[patches.member], patches.patch, f, f + 1)
    T, _ = register_patches(frames, patches, f + 1, start, np.ones(len(patches.edge_i)), capture_range)
    return SceneFlow(patches.points, transform(T[patches.owner], patches.points) - patches.points)
