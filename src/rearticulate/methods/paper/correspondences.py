"""What the energies compare the moved canonical points with; found anew as the points move.

Each search starts from its last answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rearticulate.config import NeuralConfig
from rearticulate.geometry.nearest import farthest_points
from rearticulate.methods.paper.assignment import Assignment, assign
from rearticulate.methods.paper.neighbours import BoxTree
from rearticulate.observe.flow import SceneFlow, weigh

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
Find = Callable[[Array], tuple[Tensor, Tensor]]


def kept(find: Find, every: int) -> Find:
    """`find` that is asked at one call in `every` only; the others get its last answer."""
    answers: list[tuple[Tensor, Tensor]] = []
    calls = 0

    def answer(x: Array) -> tuple[Tensor, Tensor]:
        nonlocal calls
        if calls % every == 0:
            answers[:] = [find(x)]
        calls += 1
        return answers[0]

    return answer


class Chamfer:
    """Nearest neighbours between the moved points and the frames' points, both ways.

    points (M, 3) of all frames, start (F + 1,), N canonical points. In the canonical frame every point is its own.
    """

    def __init__(self, points: Array, start: IntArray, canonical: int):
        F, own = len(start) - 1, np.arange(start[canonical], start[canonical + 1])
        self._clouds = [points[s:e] for s, e in pairwise(start)]
        self._targets = {f: BoxTree(self._clouds[f]) for f in range(F) if f != canonical}
        self._models = {f: BoxTree(points[own]) for f in self._targets}
        self._near_target = [np.full((len(own), 1), -1) for _ in self._clouds]
        self._near_model = [np.full((len(cloud), 1), -1) for cloud in self._clouds]
        self._near_target[canonical][:, 0] = self._near_model[canonical][:, 0] = np.arange(len(own))
        self._first_target = np.repeat(start[:-1], len(own))
        self._first_model = np.repeat(len(own) * np.arange(F), np.diff(start))

    def find(self, x: Array) -> tuple[Tensor, Tensor]:
        """near_target (F * N,) and near_model (M,) of `chamfer_energy` for moved points x (F, N, 3)."""
        for f, target in self._targets.items():
            model = self._models[f]
            model.move(x[f])
            target.search(x[f], self._near_target[f], model.order)
            model.search(self._clouds[f], self._near_model[f], target.order)
        return (
            torch.from_numpy(np.concatenate(self._near_target)[:, 0] + self._first_target),
            torch.from_numpy(np.concatenate(self._near_model)[:, 0] + self._first_model),
        )


class Assignments:
    """Assignment of a sample of the moved points to samples as large of the other frames' points.

    The samples are farthest points, one in `thinning` of the smallest frame's.
    """

    def __init__(self, points: Array, start: IntArray, canonical: int, thinning: int):
        N, size = int(start[canonical + 1] - start[canonical]), max(1, int(np.diff(start).min()) // thinning)
        samples = [s + farthest_points(points[s:e], size) for s, e in pairwise(start)]
        self._rows = samples[canonical] - start[canonical]
        self._samples = {f: sample for f, sample in enumerate(samples) if f != canonical}
        self._clouds = {f: points[sample] for f, sample in self._samples.items()}
        self._moved = torch.from_numpy(np.concatenate([f * N + self._rows for f in self._samples]))
        self._last: dict[int, Assignment] = {}

    def find(self, x: Array) -> tuple[Tensor, Tensor]:
        """moved (K,) and assigned (K,) of `assignment_energy` for moved points x (F, N, 3)."""
        for f, cloud in self._clouds.items():
            self._last[f] = assign(x[f, self._rows], cloud, self._last.get(f))
        assigned = [sample[self._last[f].column] for f, sample in self._samples.items()]
        return self._moved, torch.from_numpy(np.concatenate(assigned))


class Flow:
    """Observed flow at the moved points, towards the next frame (paper, sec. 3.2, "flow energy term").

    Points whose nearest anchor is far, and farther than the flow there is long, are weakly held still instead.
    flow: one record a pair of neighbouring frames; n canonical points.
    """

    def __init__(self, flow: Sequence[SceneFlow], n: int, config: NeuralConfig):
        self._config = config
        self._trees = [BoxTree(pair.anchors) for pair in flow]
        self._vectors = [np.asarray(pair.vectors, dtype=np.float32) for pair in flow]
        self._found = [np.full((n, min(config.flow_neighbours, len(pair.anchors))), -1) for pair in flow]

    def find(self, x: Array) -> tuple[Tensor, Tensor]:
        """observed (F - 1, N, 3) and weight (F - 1, N) of `flow_energy` for moved points x (F, N, 3)."""
        observed, weight = zip(*(self._look_up(f, x[f]) for f in range(len(self._trees))), strict=True)
        return torch.from_numpy(np.stack(observed)), torch.from_numpy(np.stack(weight))

    def _look_up(self, f: int, x: Array) -> tuple[Array, Array]:
        still, found = np.float32(self._config.flow_still), self._found[f]
        if not found.size:
            return np.zeros((len(x), 3), dtype=np.float32), np.full(len(x), still)
        distance = np.sqrt(self._trees[f].search(x, found))
        observed = weigh(distance, self._vectors[f][found])
        nearest = distance[:, 0]
        far = (nearest > self._config.flow_far) & (nearest > np.linalg.norm(observed, axis=1))
        return np.where(far[:, None], np.float32(0.0), observed), np.where(far, still, np.float32(1.0))
