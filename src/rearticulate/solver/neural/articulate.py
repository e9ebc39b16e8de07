"""From the relaxed model to a kinematic tree by the paper's rules: merge, project, final fit (sec. 3.3.2 and 3.3.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rearticulate.config import FitConfig
from rearticulate.solver.articulated import Articulated
from rearticulate.solver.deviation import centred, merge_still, project_deviation
from rearticulate.solver.flow import SceneFlow
from rearticulate.solver.frames import Frames
from rearticulate.solver.neural.refine import refine
from rearticulate.solver.relaxed import Relaxed, spread_labels
from rearticulate.solver.spherical import BallTree, project_balls
from rearticulate.solver.tree import choose_root

IntArray = NDArray[np.integer]


def articulate_paper(
    frames: Frames,
    canonical: int,
    relaxed: Relaxed,
    flow: Sequence[SceneFlow],
    config: FitConfig,
    progress: Callable[[str, float], None],
    device: str = "cpu",
) -> tuple[Articulated | BallTree, IntArray, float]:
    """The tree, the labels (M,) of all points, and what the canonical frame is chosen by: E_project + E_group."""
    progress("project", 0.0)
    model = merge_still(frames, canonical, relaxed, config.deviation, lambda done: progress("project", 0.5 * done))
    progress("project", 0.5)
    root = choose_root(frames, canonical, model, config.project)
    if config.deviation.joints == "ball":
        start, labels, cost = project_balls(frames, canonical, model, config.deviation, root)
    else:
        projection, cost = project_deviation(frames, canonical, model, config.deviation, root)
        start, labels = projection.tree, projection.starts[0]
    cost += centred(frames, canonical, model, config.deviation.radius).spread()
    progress("project", 1.0)
    tree = refine(frames, canonical, start, labels, flow, config.neural, progress, device)
    labels = spread_labels(frames, canonical, tree.forward(), labels[frames.rows(canonical)])
    return tree, labels, cost
