"""The page of the score by itself, without a search: what it says of the truth, and of what is nearly the truth."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.bench.cases import CAPTURED, EVERYDAY, HOUSEHOLD, ROBOTS, Case, data_folder
from rearticulate.bench.markdown import head, table
from rearticulate.bench.runner import Answer
from rearticulate.config import FitConfig
from rearticulate.evaluation.clustering import rand_index
from rearticulate.geometry.se3 import to_unit, transform, transform_by
from rearticulate.observe.frames import Frames
from rearticulate.parts.bodies import LEAST, Bodies, labels_of, make_bodies, settled
from rearticulate.parts.ownership import exchange, relabel
from rearticulate.pipeline import working_frames
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.search.moves.merge import merge_bodies
from rearticulate.search.moves.split import split_bodies

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

GROUPS = {
    "robots": ROBOTS,
    "household objects": HOUSEHOLD,
    "everyday objects": EVERYDAY,
    "seen by cameras": CAPTURED,
}
MOVED = 1.0  # spacings; a joint that moves its part by less, on average over points and frames, is not asked for
SCALES = (0.4, 0.3)
TEXT = (
    "No search: the score is asked at the true motions and labels. *Joints that pay*: of the joints that move their "
    f"part by {MOVED:g} spacing or more on average, those whose loss raises the score, both parts registered anew as "
    "one. *False splits*: pieces that the split move makes of true parts since the score falls. *Labels*: how many "
    "stay if `relabel` and `exchange` settle them under the true motions: Rand index against the true ones, and the "
    "mean error of points that they cost."
)


@dataclass(frozen=True)
class Evidence:
    """joints, paying: that move, and those whose loss raises the score. parts, pieces: true ones, and what splits make
    of them. rand; error: of labels under true motions, cm."""

    joints: int
    paying: int
    parts: int
    pieces: int
    rand: float
    error: float


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page; everything is computed here."""
    rows = []
    for group, names in GROUPS.items():
        found = []
        for name in names:
            found.append(evidence(*Case(name).load(data_folder())))
            rows.append([name, *_cells([found[-1]])])
            print(f"{name}: {', '.join(rows[-1][1:])}", file=sys.stderr, flush=True)
        rows.append([f"**{group}** ({len(names)})", *_cells(found)])
    columns = ["object", "joints that pay", "false splits", "Rand of labels", "error of labels cm"]
    return "\n\n".join([head("The score by itself", stamp), TEXT, table(columns, rows)]) + "\n"


def _cells(found: list[Evidence]) -> list[str]:
    return [
        f"{sum(e.paying for e in found)} of {sum(e.joints for e in found)}",
        f"{sum(e.pieces - e.parts for e in found)}",
        f"{np.mean([e.rand for e in found]):.3f}",
        f"{np.mean([e.error for e in found]):.3f}",
    ]


def evidence(sequence: PointSequence, truth: GroundTruth, seed: int = 0) -> Evidence:
    """What the score says of the true bodies of a recording."""
    frames, chosen = working_frames(sequence, FitConfig(), np.random.default_rng(seed))
    c = len(sequence) // 2
    true_labels = [truth.labels[f][sequence.index[f]][rows] for f, rows in enumerate(chosen)]
    labels = np.concatenate(true_labels)[frames.order]
    T = to_unit(truth.motion(c), frames.unit, frames.centre)
    bodies = make_bodies(frames, T, labels)
    joints = moving_joints(truth, frames, bodies)
    paying = sum(len(merge_bodies(frames, c, pair)) == 2 for pair in joints)
    enough = tuple(body for body in settled(frames, c, bodies, SCALES) if len(body) >= LEAST * frames.n_frames)
    now = labels_of(exchange(frames, relabel(frames, bodies)), len(labels))
    here = frames.rows(c)
    x = frames.points[here]
    shift = [transform_by(T[f], now[here], x) - transform_by(T[f], labels[here], x) for f in range(frames.n_frames)]
    return Evidence(
        joints=len(joints),
        paying=paying,
        parts=len(enough),
        pieces=len(split_bodies(frames, c, enough)),
        rand=rand_index(labels, now),
        error=100 * frames.unit * float(np.linalg.norm(shift, axis=-1).mean()),
    )


def moving_joints(truth: GroundTruth, frames: Frames, bodies: Bodies) -> list[Bodies]:
    """Part and parent of every joint that moves, if both are seen."""
    out = []
    for j, p in enumerate(truth.parent):
        if p >= 0 and min(len(bodies[j]), len(bodies[p])) >= LEAST * frames.n_frames:
            own, parents = (transform(body.T[:, None], bodies[j].z) for body in (bodies[j], bodies[p]))
            if np.linalg.norm(own - parents, axis=-1).mean() >= MOVED:
                out.append((bodies[j], bodies[p]))
    return out
