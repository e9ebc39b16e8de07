"""The direct solver: registration, and tests of every decision against the clouds. NumPy alone."""

from __future__ import annotations

import numpy as np

from rearticulate.methods.problem import Candidate, Problem
from rearticulate.parts.bodies import score_of
from rearticulate.parts.relaxed import Relaxed
from rearticulate.search.articulate import articulate
from rearticulate.search.relax import relax


def relax_direct(problem: Problem, rng: np.random.Generator) -> Relaxed:
    """Rigid parts that move freely."""
    return relax(problem.frames, problem.canonical, problem.labeller, problem.config, rng, problem.progress)


def articulate_direct(problem: Problem, relaxed: Relaxed, rng: np.random.Generator) -> Candidate:
    """The tree of joints with the lowest score."""
    frames, c = problem.frames, problem.canonical
    tree, labels = articulate(frames, c, relaxed, problem.labeller, problem.config, rng, problem.progress)
    return Candidate(c, tree, labels, score_of(frames, tree.forward(), labels) / len(labels), relaxed)
