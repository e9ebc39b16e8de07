"""The part of every point of every frame: evidence of motion, smoothed over space and time.

Two kinds of evidence stand behind one mean-field solver (Kraehenbuehl & Koltun 2011, with Potts terms):
`nearest_evidence` asks how well a point, carried by a part, lands on the other frames; `sheet_evidence` asks whether
the other frames' points, brought back by that part, form one thin sheet through it. The second sees errors far below
the point spacing and needs good motions.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import apart
from rearticulate.observe.misfit import evidence_frames, point_misfit
from rearticulate.observe.planes import draw_pair, first_state
from rearticulate.parts.relaxed import Relaxed, drop_small
from rearticulate.progress import Told, rounds, untold

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

IMPOSSIBLE = 1e3  # unary cost of a part that is no candidate
OFFSET_SCALE = 0.4  # spacings; Gaussian weight of the offset between the tangent planes of two neighbours
SPACE_SCALE = 1.87  # spacings; Gaussian weight of a spatial neighbour
TIME_SCALE = 1.12  # spacings; Gaussian weight of a neighbour in another frame
NEAREST_WEIGHT = 5.0  # of the misfit against the neighbours
CANDIDATE_RADIUS = 3.7  # spacings; parts as near as this are candidates, for coarse labels
SHEET_CANDIDATES = 3.7  # ... and for fine ones
SHEET_RADIUS = 2.6  # spacings; neighbours within this are tested for a sheet
SHEET_NEIGHBOURS = 40
SHEET_TRIES = 20  # planes
SHEET_THICKNESS = 0.093  # spacings; of points without noise
SHEET_CURVATURE = 0.008  # thickness grows by this times the squared distance, per spacing
SAMPLING_NOISE = 0.25  # spacings; deviation from a surface that sampling alone may show; what is more is noise
CERTAIN = 0.99  # a point that was this sure of its part ...
CERTAIN_RADIUS = 2.0  # ... has only candidates that are nearer than this, in spacings


@dataclass(frozen=True)
class Graph:
    """Neighbours (M, K) of every point among all frames' points, with weights."""

    neighbour: IntArray
    weight: Array

    def join(self, other: Graph, scale: float) -> Graph:
        return Graph(
            np.concatenate([self.neighbour, other.neighbour], 1), np.concatenate([self.weight, scale * other.weight], 1)
        )


def spatial_graph(frames: Frames, scale: float, offset_scale: float) -> Graph:
    """The nearest points of the same frame; Gaussian weights of the distance and of the offset between the two
    tangent planes, so that two sheets that lie close together stay apart."""
    near = frames.neighbours
    gap = frames.points[near] - frames.points[:, None]
    offset = np.maximum(frames.offsets, np.abs(np.einsum("nki,nki->nk", gap, frames.normals[near])))
    return Graph(near, np.exp(-((gap**2).sum(axis=-1) / scale**2) - (offset / offset_scale) ** 2))


def temporal_graph(
    frames: Frames, T: Array, labels: IntArray, asked: NDArray[np.bool_], targets: list[int], scale: float
) -> Graph:
    """The nearest point of every target frame under the current label, for the points asked (M,); weight 0 within the
    own frame."""
    z = transform(inverse(T)[frames.frame, labels], frames.points)
    neighbour = np.zeros((len(z), len(targets)), dtype=np.int64)
    weight = np.zeros((len(z), len(targets)))
    for k, f in enumerate(targets):
        rows = np.flatnonzero(asked & (frames.frame != f))
        d, j = nearest(frames.trees[f], transform(T[f, labels[rows]], z[rows]))
        neighbour[rows, k] = j + frames.start[f]
        weight[rows, k] = np.exp(-((d / scale) ** 2))
    return Graph(neighbour, weight)


def part_distances(frames: Frames, labels: IntArray, P: int, radius: float) -> Array:
    """(M, P) distance to the nearest member of each part in the same frame; inf beyond the radius."""
    out = np.full((len(labels), P), np.inf)
    for f in range(frames.n_frames):
        rows, tree = frames.rows(f), frames.trees[f]
        for p in np.unique(labels[rows]):
            members = tree.data[labels[rows] == p]
            low, high = members.min(axis=0) - radius, members.max(axis=0) + radius
            close = np.flatnonzero(((tree.data > low) & (tree.data < high)).all(axis=1))
            out[frames.start[f] + close, p] = nearest(search_tree(members), tree.data[close], within=radius)[0]
    return out


def doubtful(candidates: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(M,) points with more than one candidate."""
    return candidates.sum(axis=1) > 1


def nearest_evidence(frames: Frames, T: Array, candidates: NDArray[np.bool_], targets: list[int]) -> Array:
    """(M, P) mean misfit of a point to the target frames under each candidate part; IMPOSSIBLE elsewhere."""
    point, part = np.nonzero(candidates & doubtful(candidates)[:, None])
    out = np.where(candidates, 0.0, IMPOSSIBLE)
    out[point, part] = point_misfit(frames, T, part, point, targets)
    return out


@numba.njit(cache=True, nogil=True, fastmath=True)
def _sheet_support(x, y, weight, start, neighbour, thickness, curvature, tries):
    """For every point the largest weighted count of neighbours near a plane through it and two of them.

    A neighbour at w counts weight (1 - (n . w)^2 / t^2) where that is positive, t = thickness + curvature w^2.
    """
    out = np.zeros(len(x))
    most = np.diff(start).max()
    w, mass, steep = np.empty((3, most)), np.empty(most), np.empty(most)
    for i in range(len(x)):
        first, n = start[i], start[i + 1] - start[i]
        if n < 2:
            continue
        for m in range(n):
            j, squared = neighbour[first + m], 0.0
            for c in range(3):
                w[c, m] = y[j, c] - x[i, c]
                squared += w[c, m] * w[c, m]
            mass[m] = weight[j]
            steep[m] = weight[j] / (thickness + curvature * squared) ** 2
        state = first_state(i)
        best = 0.0
        for _ in range(tries):
            state, a, b = draw_pair(state, n)
            if a == b:
                continue
            ux, uy, uz = w[0, a], w[1, a], w[2, a]
            vx, vy, vz = w[0, b], w[1, b], w[2, b]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            norm = (nx * nx + ny * ny + nz * nz) ** 0.5
            lengths = ((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz)) ** 0.5
            if norm < 0.35 * lengths or norm < 1e-9:
                continue
            nx, ny, nz = nx / norm, ny / norm, nz / norm
            support = 0.0
            for m in range(n):
                d = nx * w[0, m] + ny * w[1, m] + nz * w[2, m]
                support += max(mass[m] - d * d * steep[m], 0.0)
            best = max(best, support)
        out[i] = best
    return out


def sheet_evidence(
    frames: Frames,
    T: Array,
    candidates: NDArray[np.bool_],
    belief: Array | None,
    thickness: float = SHEET_THICKNESS,
    settled: NDArray[np.bool_] | None = None,
) -> Array:
    """(M, P) minus the support of the sheet through a point under each candidate part; IMPOSSIBLE elsewhere.

    belief (M, P): current probability of every label; a neighbour that is thought to belong elsewhere counts less.
    thickness: of a sheet, in spacings. settled (M, P): candidates that are part of the sheets but are out of the
    question as labels.
    """
    point, part = np.nonzero(candidates)
    z = transform(inverse(T)[frames.frame[point], part], frames.points[point])
    weight = np.ones(len(z)) if belief is None else 0.5 + 0.5 * belief[point, part]
    keyed = apart(z, part)
    possible = candidates if settled is None else candidates & ~settled
    asked = np.flatnonzero((doubtful(possible)[:, None] & possible)[point, part])
    out = np.where(possible, 0.0, IMPOSSIBLE)
    if len(asked) == 0:
        return out
    k = min(SHEET_NEIGHBOURS, len(z))
    d, j = nearest(search_tree(keyed), keyed[asked], k=k, within=SHEET_RADIUS)
    frame = frames.frame[point]
    valid = np.isfinite(d)
    valid[valid] = frame[j[valid]] != np.broadcast_to(frame[asked][:, None], j.shape)[valid]
    start = np.concatenate([[0], np.cumsum(valid.sum(axis=1))])
    support = _sheet_support(z[asked], z, weight, start, j[valid], thickness, SHEET_CURVATURE, SHEET_TRIES)
    out[point[asked], part[asked]] = -support
    return out


@numba.njit(cache=True, nogil=True, fastmath=True)
def _mean_field_sweep(unary, q, neighbour, weight, point, first, label, out):
    """One sweep over the points (n,) with a choice; point k chooses among label[first[k] : first[k + 1]]."""
    z = np.empty(unary.shape[1], dtype=np.float32)
    for k in range(len(point)):
        i, mine = point[k], label[first[k] : first[k + 1]]
        for c in range(len(mine)):
            z[c] = -unary[i, mine[c]]
        for m in range(neighbour.shape[1]):
            w, j = weight[i, m], neighbour[i, m]
            if w > 0:
                for c in range(len(mine)):
                    z[c] += w * q[j, mine[c]]
        top = z[: len(mine)].max()
        total = np.float32(0.0)
        for c in range(len(mine)):
            z[c] = np.exp(z[c] - top)
            total += z[c]
        for c in range(len(mine)):
            out[i, mine[c]] = np.float32(0.5) * q[i, mine[c]] + np.float32(0.5) * z[c] / total


def mean_field(unary: Array, graph: Graph, iterations: int = 20) -> Array:
    """Label probabilities (M, P): damped synchronous mean field of the unary costs with Potts terms on the graph."""
    U = (unary - unary.min(axis=1, keepdims=True)).astype(np.float32)
    q = np.exp(-np.minimum(U, 50.0))
    q /= q.sum(axis=1, keepdims=True)
    possible = U < 0.5 * IMPOSSIBLE
    point = np.flatnonzero(doubtful(possible))
    first = np.concatenate([[0], np.cumsum(possible[point].sum(axis=1))])
    label = np.nonzero(possible[point])[1]
    weight, out = graph.weight.astype(np.float32), q.copy()
    for _ in range(iterations):
        _mean_field_sweep(U, q, graph.neighbour, weight, point, first, label, out)
        q, out = out, q
    return q


class Labeller:
    """Relabels all points for given motions. Keeps what does not change between calls."""

    def __init__(self, frames: Frames):
        self.frames, self.thickness = frames, SHEET_THICKNESS
        self.targets = evidence_frames(frames.n_frames)
        self.space = spatial_graph(frames, SPACE_SCALE, OFFSET_SCALE)

    def _time(self, T: Array, labels: IntArray, candidates: NDArray[np.bool_]) -> Graph:
        return temporal_graph(self.frames, T, labels, doubtful(candidates), self.targets, TIME_SCALE)

    def coarse(self, model: Relaxed, minimum_points: float, told: Told = untold) -> Relaxed:
        """Labels by nearest-point evidence; parts that end with fewer points a frame are dissolved, smallest first."""
        for _ in rounds(told):
            candidates = np.isfinite(part_distances(self.frames, model.labels, model.n_parts, CANDIDATE_RADIUS))
            U = NEAREST_WEIGHT * nearest_evidence(self.frames, model.T, candidates, self.targets)
            graph = Graph(self.space.neighbour, 0.5 * self.space.weight).join(
                self._time(model.T, model.labels, candidates), 1.0
            )
            model = Relaxed(model.T, mean_field(U, graph).argmax(axis=1))
            counts = model.counts()
            if counts.min() >= minimum_points or model.n_parts == 1:
                break
            model = drop_small(self.frames, model, np.nextafter(counts.min(), np.inf))
        return model

    def with_noise(self, noise: float) -> Labeller:
        """The same for points that scatter about their surface by noise (spacings): sheets are thicker by it."""
        out = copy(self)
        excess = max(noise**2 - SAMPLING_NOISE**2, 0.0)
        out.thickness = float(np.sqrt(self.thickness**2 + excess))
        return out

    def fine(self, model: Relaxed, belief: Array | None, told: Told = untold) -> tuple[Relaxed, Array]:
        """Labels by sheet evidence, and the belief (M, P) for the next call.

        A point whose part was certain in the last call only looks at parts that are near.
        """
        distance = part_distances(self.frames, model.labels, model.n_parts, SHEET_CANDIDATES)
        candidates = np.isfinite(distance)
        settled = np.zeros_like(candidates)
        if belief is not None:
            own = np.eye(model.n_parts, dtype=bool)[model.labels]
            settled = (belief[own] > CERTAIN)[:, None] & (distance >= CERTAIN_RADIUS) & ~own
        told(0.2)
        U = sheet_evidence(self.frames, model.T, candidates, belief, self.thickness, settled)
        told(0.8)
        candidates &= ~settled
        belief = mean_field(U, self.space)
        graph = self.space.join(self._time(model.T, belief.argmax(axis=1), candidates), 0.5)
        belief = mean_field(U, graph)
        told(1.0)
        return Relaxed(model.T, belief.argmax(axis=1)), belief
