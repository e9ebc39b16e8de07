"""The direct solver: registration, and tests of every decision against the clouds. NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rearticulate.methods.problem import Candidate, Problem, Start
from rearticulate.parts.bodies import score_of
from rearticulate.parts.relaxed import Relaxed
from rearticulate.search.articulate import articulate
from rearticulate.search.relax import relax


def relax_direct(problem: Problem, rng: np.random.Generator) -> Relaxed:
    """Rigid parts that move freely."""
    return relax(problem.frames, problem.canonical, problem.config, rng, problem.progress)


def articulate_direct(problem: Problem, starts: Sequence[Start], rng: np.random.Generator) -> Candidate:
    """The tree of joints with the lowest score."""
    frames, c, relaxed = problem.frames, problem.canonical, starts[0].relaxed
    others = [start.relaxed for start in starts[1:]]
    tree, labels = articulate(frames, c, relaxed, others, problem.config, rng, problem.progress)
    return Candidate(c, tree, labels, score_of(frames, tree.forward(), labels) / len(labels), relaxed)
