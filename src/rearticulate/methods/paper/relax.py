"""The paper's relaxed model: part field and part poses, fitted together by gradient descent (paper, sec. 3.3.1).

First with the Chamfer and flow terms, then with the earth mover's and flow terms. A shape term that is switched
off gives its iterations to the other one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from torch import Tensor, nn

from rearticulate.config import NeuralConfig
from rearticulate.geometry.nearest import farthest_points, nearest, rms_radius, search_tree
from rearticulate.geometry.se3 import from_unit, to_unit
from rearticulate.methods.paper.correspondences import Assignments, Chamfer, Find, Flow, kept
from rearticulate.methods.paper.energies import assignment_energy, chamfer_energy, flow_energy
from rearticulate.methods.paper.field import PartField, PointChoices, cosine, draw_parts, fit_labels
from rearticulate.methods.paper.poses import IDENTITY, from_matrices, move, to_matrices, with_identity
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import Relaxed, keep_parts, spread_labels

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
Energy = Callable[[Tensor], Tensor]

REPORTS = 100  # calls of progress


@dataclass(frozen=True)
class Scene:
    """The frames as the fit sees them: about the centroid of the canonical points, in a unit of its own.

    points (M, 3) of all frames, start (F + 1,), flow between neighbouring frames. scale: of a point spacing;
    centre (3,): in point spacings. device: where its tensors are.
    """

    points: Array
    start: IntArray
    canonical: int
    flow: tuple[SceneFlow, ...]
    scale: float
    centre: Array
    device: str = "cpu"

    def tensor(self, values: NDArray[Any]) -> Tensor:
        """On the device of the scene."""
        return torch.from_numpy(values).to(self.device)

    @property
    def canonical_points(self) -> Array:
        """(N, 3)."""
        return self.points[self.start[self.canonical] : self.start[self.canonical + 1]]

    def poses_in(self, T: Array) -> Array:
        """(..., 4, 4) motions in the frames' units -> here."""
        return to_unit(T, 1 / self.scale, self.centre)

    def poses_out(self, T: Array) -> Array:
        """(..., 4, 4) motions -> in the frames' units."""
        return from_unit(T, 1 / self.scale, self.centre)


def make_scene(frames: Frames, canonical: int, flow: Sequence[SceneFlow], radius: float, device: str = "cpu") -> Scene:
    """Scale the canonical points to an rms distance `radius` from their centroid."""
    points = frames.points[frames.rows(canonical)]
    centre = points.mean(axis=0)
    scale = radius / rms_radius(points)
    return Scene(
        points=(scale * (frames.points - centre)).astype(np.float32),
        start=frames.start,
        canonical=canonical,
        flow=tuple(SceneFlow(scale * (pair.anchors - centre), scale * pair.vectors) for pair in flow),
        scale=scale,
        centre=centre,
        device=device,
    )


class Model(nn.Module):
    """Part field, and part poses (F - 1, P, 9) of all frames but the canonical one, where they are the identity."""

    def __init__(self, scene: Scene, parts: int, config: NeuralConfig, generator: torch.Generator):
        super().__init__()
        self.canonical, self.config, self.generator = scene.canonical, config, generator
        self.points = scene.tensor(scene.canonical_points)
        self.field = (
            PartField(parts, config.hidden, generator)
            if config.field
            else PointChoices(parts, len(self.points), generator)
        )
        still = torch.tensor([*IDENTITY, 0.0, 0.0, 0.0], device=scene.device)
        self.poses = nn.Parameter(still.repeat(len(scene.start) - 2, parts, 1))

    def start_from(self, scene: Scene, labels: IntArray, T: Array) -> None:
        """Take over labels (N,) of the canonical points and motions T (F, P, 4, 4) in the frames' units."""
        fit_labels(self.field, self.points, scene.tensor(labels), self.config)
        others = np.delete(scene.poses_in(T), self.canonical, axis=0)
        self.poses.data = from_matrices(scene.tensor(others)).to(self.poses.dtype)

    def matrices(self, poses: Tensor) -> Tensor:
        """(F, P, 3, 4) with the identity at the canonical frame."""
        return with_identity(to_matrices(poses), self.canonical)

    def forward(self, temperature: float) -> Tensor:
        """(F, N, 3) the canonical points moved by the poses of drawn (or blended) parts."""
        logits = self.field(self.points)
        if self.config.gumbel:
            weights = draw_parts(logits, temperature, self.generator)
        else:
            weights = (logits / temperature).softmax(dim=1)
        return move(self.matrices(self.poses), weights, self.points)

    def labels(self) -> IntArray:
        """(N,) likeliest part of the canonical points."""
        with torch.no_grad():
            return self.field(self.points).argmax(dim=1).numpy(force=True)

    def motions(self) -> Array:
        """(F, P, 4, 4) in double precision."""
        with torch.no_grad():
            top = self.matrices(self.poses.double()).numpy(force=True)
        T = np.zeros((*top.shape[:2], 4, 4))
        T[..., :3, :], T[..., 3, 3] = top, 1.0
        return T


def relax_neural(
    frames: Frames,
    canonical: int,
    flow: Sequence[SceneFlow],
    config: NeuralConfig,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
    start: Relaxed | None = None,
    device: str = "cpu",
) -> Relaxed:
    """Fit a relaxed model to the frames and the flow between them, both in the frames' units.

    flow: one record a pair of neighbouring frames. start: a model whose labels and poses the fit begins with; without
    it all parts begin at rest, as `config.start` says. On one thread, so that the same rng gives the same bits. device:
    of the descent; correspondences are found on the CPU.
    """
    progress("relax", 0.0)
    scene = make_scene(frames, canonical, flow, config.radius, device)
    generator = torch.Generator(device).manual_seed(int(rng.integers(2**63)))
    with threadpool_limits(1):
        model = Model(scene, config.parts if start is None else start.n_parts, config, generator)
        if start is not None:
            model.start_from(scene, start.labels[frames.rows(canonical)], start.T)
        elif config.start == "cells":
            fit_labels(model.field, model.points, scene.tensor(cells(scene.canonical_points, config.parts)), config)
        told = 0
        for done in descend(model, scene, config):
            if done * REPORTS > told:
                progress("relax", done)
                told += 1
        progress("relax", 1.0)
        labels, T = model.labels(), scene.poses_out(model.motions())
    T[canonical] = np.eye(4)
    relaxed = Relaxed(T, spread_labels(frames, canonical, T, labels))
    return dissolve(frames, canonical, relaxed, config.minimum_points)


def cells(points: Array, count: int) -> IntArray:
    """(N,) which of `count` farthest points each point (N, 3) is nearest to."""
    nodes = points[farthest_points(points, min(count, len(points)))]
    return nearest(search_tree(nodes), points)[1]


def descend(model: Model, scene: Scene, config: NeuralConfig) -> Iterator[float]:
    """Adam on the energy of `energies`, with the temperature and the rates of the paper. Yields the share done after
    every iteration."""
    rates = [config.rate_field if config.field else config.rate_poses, config.rate_poses]
    optimiser = torch.optim.Adam(
        [{"params": model.field.parameters()}, {"params": [model.poses]}], lr=rates[0], foreach=True
    )
    count = config.chamfer_iterations + config.emd_iterations
    for i, energy in enumerate(energies(scene, config)):
        done = i / count
        for group, rate in zip(optimiser.param_groups, rates, strict=True):
            group["lr"] = cosine(rate, config.rate_end * rate, done)
        optimiser.zero_grad()
        energy(model(cosine(config.temperature, config.temperature_end, done))).backward()
        optimiser.step()
        yield (i + 1) / count


def energies(scene: Scene, config: NeuralConfig) -> Iterator[Energy]:
    """The energy of every iteration, as a function of the moved points."""
    chamfer = chamfer_term(scene, config) if config.chamfer else None
    emd = emd_term(scene, config) if config.emd else None
    flow = flow_term(scene, config) if config.flow else None
    yield from repeat(total(chamfer or emd, flow), config.chamfer_iterations)
    yield from repeat(total(emd or chamfer, flow), config.emd_iterations)


def total(*terms: Energy | None) -> Energy:
    """The sum of the terms there are."""
    return lambda x: torch.stack([term(x) for term in terms if term is not None]).sum()


def ask(find: Find, x: Tensor) -> tuple[Tensor, Tensor]:
    """Correspondences of moved points, where these are."""
    a, b = find(x.numpy(force=True))
    return a.to(x.device), b.to(x.device)


def chamfer_term(scene: Scene, config: NeuralConfig) -> Energy:
    """Weighted E_CD of the moved points."""
    target = scene.tensor(scene.points)
    find = kept(Chamfer(scene.points, scene.start, scene.canonical).find, config.chamfer_every)
    return lambda x: config.chamfer * chamfer_energy(x, target, *ask(find, x))


def emd_term(scene: Scene, config: NeuralConfig) -> Energy:
    """Weighted E_EMD."""
    target = scene.tensor(scene.points)
    search = Assignments(scene.points, scene.start, scene.canonical, config.emd_thinning)
    find = kept(search.find, config.emd_every)
    return lambda x: config.emd * assignment_energy(x, target, *ask(find, x))


def flow_term(scene: Scene, config: NeuralConfig) -> Energy:
    """Weighted E_flow."""
    find = kept(Flow(scene.flow, len(scene.canonical_points), config).find, config.flow_every)
    return lambda x: config.flow * flow_energy(x, *ask(find, x))


def dissolve(frames: Frames, canonical: int, model: Relaxed, minimum: int) -> Relaxed:
    """Give the points of parts with fewer canonical points to the nearest other part (the largest part stays)."""
    counts = np.bincount(model.labels[frames.rows(canonical)], minlength=model.n_parts)
    return keep_parts(frames, model, np.flatnonzero((counts >= minimum) | (np.arange(len(counts)) == counts.argmax())))
