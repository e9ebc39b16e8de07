"""The paper's method: free parts by gradient descent, then merge, project and final fit (sec. 3.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rearticulate.joints.tree import choose_root
from rearticulate.methods.deviation import centred, merge_still, project_deviation
from rearticulate.methods.direct import relax_direct
from rearticulate.methods.paper.refine import refine
from rearticulate.methods.paper.relax import relax_neural
from rearticulate.methods.problem import Candidate, Problem, Start
from rearticulate.methods.spherical import project_balls
from rearticulate.parts.relaxed import Relaxed, spread_labels


def relax_paper(problem: Problem, rng: np.random.Generator) -> Relaxed:
    """The paper's relaxed model, from the start that the settings name."""
    settings = problem.config.neural
    start = relax_direct(problem, rng) if settings.start == "direct" else None
    return relax_neural(
        problem.frames, problem.canonical, problem.flow, settings, rng, problem.progress, start, problem.device
    )


def articulate_paper(problem: Problem, starts: Sequence[Start], rng: np.random.Generator) -> Candidate:
    """The tree by the paper's rules. What canonical frames are chosen by is E_project + E_group."""
    frames, canonical, config, progress = problem.frames, problem.canonical, problem.config, problem.progress
    relaxed = starts[0].relaxed
    progress("project", 0.0)
    model = merge_still(frames, canonical, relaxed, config.deviation, lambda done: progress("project", 0.5 * done))
    progress("project", 0.5)
    root = choose_root(frames, canonical, model)
    if config.deviation.joints == "ball":
        start, labels, cost = project_balls(frames, canonical, model, config.deviation, root)
    else:
        projection, cost = project_deviation(frames, canonical, model, config.deviation, root)
        start, labels = projection.tree, projection.starts[0]
    cost += centred(frames, canonical, model, config.deviation.radius).spread()
    progress("project", 1.0)
    tree = refine(frames, canonical, start, labels, problem.flow, config.neural, progress, problem.device)
    labels = spread_labels(frames, canonical, tree.forward(), labels[frames.rows(canonical)])
    return Candidate(canonical, tree, labels, cost, relaxed)
