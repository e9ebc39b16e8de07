"""The page of inner loops: an iteration of the paper's relaxed fit, the searches inside it, the network's features."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice, pairwise
from statistics import median

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits
from torch import Tensor

from rearticulate.bench.cases import Case, data_folder
from rearticulate.bench.markdown import head, table
from rearticulate.bench.runner import Answer
from rearticulate.config import PRESETS, NeuralConfig
from rearticulate.geometry.nearest import farthest_points, nearest, rms_radius, search_tree
from rearticulate.methods.paper.assignment import Assignment, assign
from rearticulate.methods.paper.neighbours import BoxTree
from rearticulate.methods.paper.relax import Model, Scene, descend, make_scene
from rearticulate.methods.paper.scene_flow import observed_flow
from rearticulate.network.inference import load_network
from rearticulate.network.pyramid import build_pyramid
from rearticulate.observe.frames import make_frames
from rearticulate.training.pointnet import Batch, CorrespondenceNet

Array = NDArray[np.floating]

CANONICAL = 5
WARM = 300  # iterations before the clock starts
TIMED = 60
PLAIN = 5  # iterations of the plain transcription
REPEATS = 12
SECOND = 1e3  # milliseconds


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page; everything is measured here, on one core."""
    sequence, _ = Case("nao").load(data_folder())
    frames = make_frames(list(sequence.points))
    config = PRESETS["paper"].neural
    scene = make_scene(frames, CANONICAL, observed_flow(frames, PRESETS["paper"]), config.radius)
    with threadpool_limits(1):
        plain = list(plain_iterations(scene))
        rows = [["Chamfer forward and backward, all pairs of points (`torch.cdist`)", _cell(plain), "1"]]
        for label, chosen in (("Chamfer and flow", {"emd": 0.0}), ("assignment and flow", {"chamfer": 0.0})):
            times = list(iterations(scene, replace(config, **chosen)))
            rows.append([f"whole iteration, {label}", _cell(times), f"{median(plain) / median(times):.0f}"])
        moving = list(moving_clouds(scene, config))
        rows += searches(scene, moving)
        features = table(["", "ms"], network_times(sequence.points[CANONICAL]))
    text = (
        f"Nao, {len(sequence)} frames of {len(scene.canonical_points)} points, one core; median milliseconds. An "
        "iteration moves all canonical points to all frames, searches, and takes a step of the optimiser. An "
        f"assignment, of one point in {config.emd_thinning}, is kept for {config.emd_every} iterations. Searches are "
        "those of all other frames, for points that moved by one iteration since the last search, or by five "
        "(assignment)."
    )
    relaxed = table(["", "ms", "times faster"], rows)
    return "\n\n".join([head("Inner loops", stamp), text, relaxed, "Features of the network:", features]) + "\n"


def plain_iterations(scene: Scene) -> Iterator[float]:
    """Milliseconds of iterations of the Chamfer term without any search structure."""
    model = _model(scene, PRESETS["paper"].neural)
    clouds = [torch.from_numpy(scene.points[s:e]) for s, e in pairwise(scene.start)]
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-2)
    for _ in range(PLAIN):
        started = time.perf_counter()
        optimiser.zero_grad()
        torch.stack([_plain_chamfer(x, cloud) for x, cloud in zip(model(5.0), clouds, strict=True)]).sum().backward()
        optimiser.step()
        yield SECOND * (time.perf_counter() - started)


def _plain_chamfer(x: Tensor, cloud: Tensor) -> Tensor:
    with torch.no_grad():
        distance = torch.cdist(x, cloud)
        there, back = distance.argmin(dim=1), distance.argmin(dim=0)
    return (x - cloud[there]).square().sum() + (x[back] - cloud).square().sum()


def iterations(scene: Scene, config: NeuralConfig) -> Iterator[float]:
    """Milliseconds of iterations of the relaxed fit, after some to warm up: means over as many as an assignment is
    kept."""
    steps = descend(_model(scene, config), scene, config)
    for _ in islice(steps, WARM):
        pass
    for _ in range(TIMED // config.emd_every):
        started = time.perf_counter()
        for _ in range(config.emd_every):
            next(steps)
        yield SECOND * (time.perf_counter() - started) / config.emd_every


def moving_clouds(scene: Scene, config: NeuralConfig) -> Iterator[Array]:
    """(F, N, 3) the moved points of successive iterations in the midst of a fit."""
    model = _model(scene, config)
    for _ in islice(descend(model, scene, config), WARM, WARM + TIMED):
        with torch.no_grad():
            yield model(config.temperature).numpy()


def searches(scene: Scene, moving: list[Array]) -> list[list[str]]:
    """Rows: nearest neighbours and assignment, by a library and by ours."""
    clouds = [scene.points[s:e] for s, e in pairwise(scene.start)]
    others = [f for f in range(len(clouds)) if f != scene.canonical]
    still = {f: search_tree(clouds[f]) for f in others}
    trees = {f: (BoxTree(clouds[f]), BoxTree(clouds[scene.canonical])) for f in others}
    kept = {f: (np.full((moving[0].shape[1], 1), -1), np.full((len(clouds[f]), 1), -1)) for f in others}

    def by_library(x: Array) -> None:
        for f in others:
            nearest(still[f], x[f])
            nearest(search_tree(x[f]), clouds[f])

    def by_boxes(x: Array) -> None:
        for f in others:
            (target, model), (there, back) = trees[f], kept[f]
            model.move(x[f])
            target.search(x[f], there, model.order)
            model.search(clouds[f], back, target.order)

    size = len(clouds[0]) // PRESETS["paper"].neural.emd_thinning
    samples = [cloud[farthest_points(cloud, size)] for cloud in clouds]
    rows_of = farthest_points(clouds[scene.canonical], size)
    last: dict[int, Assignment] = {}

    def by_scipy(x: Array) -> None:
        for f in others:
            linear_sum_assignment(cdist(x[f, rows_of], samples[f], "sqeuclidean"))

    def by_paths(x: Array) -> None:
        for f in others:
            last[f] = assign(x[f, rows_of], samples[f], last.get(f))

    found = []
    for label, library, ours, every in (
        ("nearest neighbours both ways: SciPy's k-d tree", by_library, by_boxes, 1),
        ("assignments: SciPy, costs included", by_scipy, by_paths, 5),
    ):
        theirs, own = timed(library, moving[:: 2 * every]), timed(ours, moving[::every])
        found.append([label, _cell(theirs), "1"])
        found.append([f"{label.split(':')[0]}: ours", _cell(own), f"{median(theirs) / median(own):.1f}"])
    return found


def network_times(cloud: Array) -> list[list[str]]:
    """Rows: the pyramid of a cloud, and its features by either implementation."""
    ours, net = load_network(), CorrespondenceNet().eval()
    pyramid = build_pyramid(cloud, rms_radius(cloud))

    @torch.no_grad()
    def by_torch(_: Array) -> None:
        net(Batch([pyramid]))

    steps: dict[str, Callable[[Array], object]] = {
        f"pyramid of {len(cloud)} points": lambda x: build_pyramid(x, rms_radius(x)),
        "features, NumPy": lambda _: ours.features(pyramid),
        "features, PyTorch": by_torch,
    }
    return [[label, _cell(timed(step, [cloud] * REPEATS))] for label, step in steps.items()]


def timed(search: Callable[[Array], object], moving: list[Array]) -> list[float]:
    """Milliseconds of every search but the first."""
    times = []
    for x in moving:
        started = time.perf_counter()
        search(x)
        times.append(SECOND * (time.perf_counter() - started))
    return times[1:]


def _model(scene: Scene, config: NeuralConfig) -> Model:
    return Model(scene, config.parts, config, torch.Generator().manual_seed(0))


def _cell(times: list[float]) -> str:
    return f"{median(times):.1f}"
