"""The page of the correspondence network: its flow against others, and what it is worth to the tracking."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rearticulate.bench.cases import PAPER_TEST, PAPER_VALIDATION, Case, data_folder
from rearticulate.bench.columns import COLUMNS, answers_of, mean_metrics, number_cell
from rearticulate.bench.markdown import head, table
from rearticulate.bench.published import SIX
from rearticulate.bench.runner import Answer, Job
from rearticulate.bench.variants import VARIANTS
from rearticulate.config import PRESETS, FitConfig
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import transform
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import make_frames
from rearticulate.parts.patches import track_patches
from rearticulate.synth.perturb import stepped_pair

Array = NDArray[np.floating]
Follow = Callable[[Array, Array], SceneFlow]

ROBOTS = (*PAPER_VALIDATION, *PAPER_TEST)
STEPS_DEG = (5, 10, 20, 30)
FRAMES = (2, 7)  # each robot steps from these
POINTS = 4096
WITHIN = (0.01, 0.02, 0.05)  # of the object's diagonal
FAR = "every_third_frame"
COMPARED = ("direct", "without network")
JOBS = [Job(Case(name, FAR), preset) for name in ROBOTS for preset in COMPARED]


def spatial_neighbours(a: Array, b: Array) -> SceneFlow:
    """Points that are each other's nearest in space."""
    forth, back = nearest(search_tree(b), a)[1], nearest(search_tree(a), b)[1]
    rows = np.flatnonzero(back[forth] == np.arange(len(a)))
    return SceneFlow(a[rows], b[forth[rows]] - a[rows])


def patch_tracking(config: FitConfig, a: Array, b: Array) -> SceneFlow:
    """The direct solver's tracking from the first cloud to the second."""
    frames = make_frames([a, b])
    tracks = track_patches(frames, 0, config)
    x = frames.points[frames.rows(0)]
    moved = transform(tracks.T[1, tracks.patches.owner], x)
    return SceneFlow(x * frames.unit + frames.centre, (moved - x) * frames.unit)


def network_matches(refined: bool, a: Array, b: Array) -> SceneFlow:
    """Matches of the shipped network, as they are or refined."""
    from rearticulate.methods.paper.scene_flow import observed_flow

    frames, config = make_frames([a, b]), PRESETS["paper"]
    flow = observed_flow(frames, replace(config, neural=replace(config.neural, refined=refined)))[0]
    return SceneFlow(flow.anchors * frames.unit + frames.centre, flow.vectors * frames.unit)


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
    return mean_metrics(found)


def pairs() -> list[str]:
    """Text and tables of single steps; everything is measured here."""
    followers: dict[str, Follow] = {
        "nearest neighbours": spatial_neighbours,
        "network": partial(network_matches, False),
        "network, refined": partial(network_matches, True),
        "tracking without network": partial(patch_tracking, VARIANTS["without network"]),
        "tracking": partial(patch_tracking, VARIANTS["direct"]),
    }
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
        ["**mean**", f"{step}", label, *_cells(mean_metrics(found[name, step, label] for name in ROBOTS))]
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
    return [text, table(heads, means), table(heads, rows)]


def fits(answers: dict[str, Answer]) -> list[str]:
    """Text and table of whole fits to frames that lie far apart, with the network's start and without it."""
    groups = [(name, (name,)) for name in ROBOTS] + [("**mean**", ROBOTS)]
    rows = []
    for label, names in groups:
        for preset in COMPARED:
            have = answers_of(preset, [f"{name}/{FAR}" for name in names], answers)
            found = mean_metrics(a["metrics"] for a in have) if len(have) == len(names) else {}
            rows.append([label, preset, *(number_cell(found.get(key), key) for key in SIX)])
    text = (
        "Whole fits of the default to every third frame. The network's matches are one more start of the tracking "
        "where a frame fits badly; *without network* leaves them out."
    )
    return [text, table(["robot", "", *(COLUMNS[key][0] for key in SIX)], rows)]


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page."""
    sections = ["## Single steps", *pairs(), "## Frames far apart", *fits(answers)]
    return "\n\n".join([head("Correspondences", stamp), *sections]) + "\n"


def _cells(found: dict[str, float]) -> list[str]:
    return [f"{100 * found['epe']:.2f}", *(f"{value:.3f}" for key, value in found.items() if key != "epe")]
