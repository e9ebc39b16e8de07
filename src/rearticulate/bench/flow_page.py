"""The page of the correspondence network: its matches and flow against nearest neighbours and the patch tracking."""

from __future__ import annotations

from collections.abc import Callable
from statistics import mean

import numpy as np
from numpy.typing import NDArray

from rearticulate.bench.cases import PAPER_TEST, PAPER_VALIDATION, Case, data_folder
from rearticulate.bench.markdown import head, table
from rearticulate.bench.runner import Answer
from rearticulate.config import FitConfig
from rearticulate.fit.flow import SceneFlow
from rearticulate.fit.frames import make_frames
from rearticulate.fit.track import track
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.network.correspond import match_sequence
from rearticulate.network.inference import load_network
from rearticulate.synth.perturb import stepped_pair

Array = NDArray[np.floating]
Follow = Callable[[Array, Array], SceneFlow]

ROBOTS = (*PAPER_VALIDATION, *PAPER_TEST)
STEPS_DEG = (5, 10, 20, 30)
FRAMES = (2, 7)  # each robot steps from these
POINTS = 4096
WITHIN = (0.01, 0.02, 0.05)  # of the object's diagonal


def spatial_neighbours(a: Array, b: Array) -> SceneFlow:
    """Points that are each other's nearest in space."""
    forth, back = nearest(search_tree(b), a)[1], nearest(search_tree(a), b)[1]
    rows = np.flatnonzero(back[forth] == np.arange(len(a)))
    return SceneFlow(a[rows], b[forth[rows]] - a[rows])


def patch_tracking(a: Array, b: Array) -> SceneFlow:
    """The direct solver's tracking from the first cloud to the second."""
    frames = make_frames([a, b])
    tracks = track(frames, 0, FitConfig().track, lambda done: None)
    x = frames.points[frames.rows(0)]
    moved = transform(tracks.T[1, tracks.patches.owner], x)
    return SceneFlow(x * frames.unit + frames.centre, (moved - x) * frames.unit)


def network_matches() -> Follow:
    """Mutual matches of the shipped network."""
    net = load_network()

    def follow(a: Array, b: Array) -> SceneFlow:
        i, j = match_sequence(net, [a, b])[0]
        return SceneFlow(a[i], b[j] - a[i])

    return follow


def errors(follow: Follow, a: Array, b: Array, truth: Array) -> dict[str, float]:
    """End-point error of the flow interpolated everywhere, share of matches within limits, share of points matched."""
    flow = follow(a, b)
    size = float(np.linalg.norm(np.ptp(a, axis=0)))
    dense = np.linalg.norm(a + flow.interpolate(a)[0] - truth, axis=1)
    own = nearest(search_tree(a), flow.anchors)[1]
    off = np.linalg.norm(flow.anchors + flow.vectors - truth[own], axis=1) / size
    within = {f"within_{limit:.0%}": float((off < limit).mean()) if len(off) else 0.0 for limit in WITHIN}
    return {"epe": float(dense.mean() / size), **within, "coverage": len(flow.anchors) / len(a)}


def measure(follow: Follow, name: str, step_deg: float) -> dict[str, float]:
    """Mean of `errors` over a few steps of one robot."""
    sequence, truth = Case(name).load(data_folder())
    found = [errors(follow, *stepped_pair(sequence, truth, f, POINTS, step_deg, seed=f)) for f in FRAMES]
    return _mean(found)


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page; everything is measured here."""
    followers = {"nearest": spatial_neighbours, "tracking": patch_tracking, "network": network_matches()}
    found = {
        (name, step, label): measure(follow, name, step)
        for name in ROBOTS
        for step in STEPS_DEG
        for label, follow in followers.items()
    }
    rows = [
        [name, f"{step}", label, *_cells(found[name, step, label])]
        for name in ROBOTS
        for step in STEPS_DEG
        for label in followers
    ]
    means = [
        ["**mean**", f"{step}", label, *_cells(_mean([found[name, step, label] for name in ROBOTS]))]
        for step in STEPS_DEG
        for label in followers
    ]
    heads = ["robot", "step deg", "by", "EPE %", *(f"within {limit:.0%}" for limit in WITHIN), "coverage"]
    text = (
        f"Every joint of a robot turns by about the given step, from {len(FRAMES)} postures; two clouds of {POINTS} "
        "points that share none. EPE: mean error of the flow, interpolated from the matches to all points, in percent "
        "of the object's diagonal. Within: share of the matches that end as near to the truth. Coverage: share of the "
        "points that are matched."
    )
    return "\n\n".join([head("Correspondences", stamp), text, table(heads, means), table(heads, rows)]) + "\n"


def _mean(found: list[dict[str, float]]) -> dict[str, float]:
    return {key: mean(one[key] for one in found) for key in found[0]}


def _cells(found: dict[str, float]) -> list[str]:
    return [f"{100 * found['epe']:.2f}", *(f"{value:.3f}" for key, value in found.items() if key != "epe")]
