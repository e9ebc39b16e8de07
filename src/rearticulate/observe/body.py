"""A rigid body seen in every frame: its points of all frames carried to one, how well they agree, and the motion under
which they agree best.

Whether points belong to one body that moves so is asked of these points alone: each must find points of the body in
the other frames where it lands. Half of the misfit is minus a log-likelihood: of the distance from the plane of one of
these points, with the noise of the surface, and of the distance within the plane, since a frame is a fresh draw of
points of known density; of all points near it counts the one that fits best. Where no point of the body is near,
another body's points lie there, or none, and the frame denies it. All lengths are in spacings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.geometry.cells import sort_into_cells
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3, inverse, rotate_by, transform_by
from rearticulate.observe.frames import NOISE_FLOOR, Frames
from rearticulate.observe.misfit import evidence_frames
from rearticulate.observe.planes import Planes, find_planes, keep_planes, plane_layers
from rearticulate.observe.register import CONVERGED, normal_equations, solve_twists

EVIDENCE_FRAMES = 6  # that a point is looked for in, at most
REACH = 3.0  # within it a frame has a point of the same surface
LEAST = 4  # points that tell planes
WITHIN = 0.7  # per squared spacing: half of what the nearest of fresh points in the plane costs, 2 pi density
DENIED = 9.0  # misfit of a point that a frame does not confirm
SURE = 2.2  # standard errors of a growth of misfit
VAGUE = 6.0  # misfit up to which a point is not denied: it may have a neighbour that the draw missed
NONE, HERE = -1, -2  # instead of a partner: the frame has none, or is the point's own
ASKED = 1500  # points of a body that take part in a registration
INNER, HELD = 4, 2  # steps of a registration at one robust scale, and those from the same pairs
POINT_SHARE = 0.02  # of the squared distance of a pair in what is robust in a registration ...
POINT_WEIGHT = 0.01  # ... and in what it brings together
MAX_STEP = 0.5
STAYED = 0.2  # spacings; mean motion of points below which their neighbours, and what was tried, still hold
STILL = 0.02  # ... their normals
SAME = 0.97  # share of the points of the larger of two bodies that are alike


@dataclass(frozen=True)
class Body:
    """rows (n,) of its points, frame (n,) of each; T (F, 4, 4) T_frame_canonical; points z (n, 3) and normals (n, 3) in
    the canonical frame. planes: of single points, where they were asked for."""

    rows: Int[Array, " n"]
    frame: Int[Array, " n"]
    T: Float[Array, "F 4 4"]
    z: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    planes: Planes | None = None

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, rows: Int[Array, " m"] | Bool[Array, " n"]) -> Body:
        return Body(self.rows[rows], self.frame[rows], self.T, self.z[rows], self.normals[rows])

    def carry(self, frames: Frames, rows: Int[Array, " m"]) -> tuple[Float[Array, "m 3"], Int[Array, " m"]]:
        """Any points (n,) as if they were the body's: carried to the canonical frame (n, 3), and their frames (n,)."""
        frame = frames.frame[rows]
        return transform_by(inverse(self.T), frame, frames.points[rows]), frame

    def moved(self, T: Float[Array, "F 4 4"]) -> Body:
        """The same points under another motion (F, 4, 4)."""
        D = inverse(T) @ self.T
        z, normals = transform_by(D, self.frame, self.z), rotate_by(D, self.frame, self.normals)
        return Body(self.rows, self.frame, T, z, normals)


def join(a: Body, b: Body) -> Body:
    """The points of both, which have the same motion."""
    return Body(
        np.concatenate([a.rows, b.rows]),
        np.concatenate([a.frame, b.frame]),
        a.T,
        np.concatenate([a.z, b.z]),
        np.concatenate([a.normals, b.normals]),
    )


def carried(frames: Frames, rows: Int[Array, " n"], T: Float[Array, "F 4 4"], normals: Float[Array, "M 3"]) -> Body:
    """The body of these points under this motion, with known normals (M, 3) of all points in their frames."""
    frame = frames.frame[rows]
    back = inverse(T)
    return Body(rows, frame, T, transform_by(back, frame, frames.points[rows]), rotate_by(back, frame, normals[rows]))


def make_body(frames: Frames, rows: Int[Array, " n"], T: Float[Array, "F 4 4"], before: Body | None = None) -> Body:
    """The body of these points under this motion, with new normals. before: one of mostly the same points."""
    if before is not None and np.array_equal(before.rows, rows):
        return renewed(before.moved(T), before)
    frame = frames.frame[rows]
    z = transform_by(inverse(T), frame, frames.points[rows])
    return renewed(Body(rows, frame, T, z, np.zeros_like(z)), before)


@numba.njit(cache=True, nogil=True)
def _same(a, b):
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@numba.njit(cache=True, nogil=True)
def _gather(cell, start, shape, cloud, target, first, near, name):
    """Sort what lies in the cells around one by target: columns (6, k) of the cloud and names, first (G + 1,) of each
    target."""
    below, above = max(cell[2] - 1, 0), min(cell[2] + 2, shape[2])
    free = np.empty(len(first), np.int64)
    for filling in (False, True):  # first they are counted
        free[:] = first
        first[1:] = 0
        for a in range(max(cell[0] - 1, 0), min(cell[0] + 2, shape[0])):
            for b in range(max(cell[1] - 1, 0), min(cell[1] + 2, shape[1])):
                base = (a * shape[1] + b) * shape[2]
                for j in range(start[base + below], start[base + above]):
                    k = free[target[j]]
                    free[target[j]] += 1
                    first[target[j] + 1] += 1
                    if filling:
                        name[k] = j
                        for c in range(6):
                            near[c, k] = cloud[c, j]
        for g in range(len(first) - 1):
            first[g + 1] += first[g]


@numba.njit(cache=True, nogil=True)
def _best_partners(z, order, place, start, shape, cloud, target, row, noise, within, reach, misfit, partner):
    """For each point z, of the points of each target frame but its own in the cells around it, the one that fits
    best. Points in the same cell, one after the other in `order`, are asked together. cloud (6, m): coordinates and
    normals."""
    m = len(row)
    first, name = np.zeros(misfit.shape[1] + 1, np.int64), np.empty(m, np.int64)
    near, cost = np.empty((6, m)), np.empty(m)
    x, y, u, nx, ny, nz = near[0], near[1], near[2], near[3], near[4], near[5]
    for w, i in enumerate(order):
        before = order[max(w - 1, 0)]
        if w == 0 or not _same(place[i], place[before]):
            _gather(place[i], start, shape, cloud, target, first, near, name)
        px, py, pz = z[i, 0], z[i, 1], z[i, 2]
        for g in range(misfit.shape[1]):
            if partner[i, g] == HERE:
                continue
            best, who = np.inf, NONE
            for k in range(first[g], first[g + 1]):  # without branches: several at a time
                dx, dy, dz = px - x[k], py - y[k], pz - u[k]
                square = dx * dx + dy * dy + dz * dz
                across = nx[k] * dx + ny[k] * dy + nz[k] * dz
                across *= across
                value = across / (noise * noise) + within * max(square - across, 0.0)
                cost[k] = value if square <= reach * reach else np.inf
            for k in range(first[g], first[g + 1]):
                if cost[k] < best:
                    best, who = cost[k], k
            if who >= 0:
                misfit[i, g], partner[i, g] = best, row[name[who]]


def partners(
    z: Float[Array, "n 3"], frame: Int[Array, " n"], body: Body, noise: float, targets: Sequence[int] | None = None
) -> tuple[Float[Array, "n G"], Int[Array, "n G"]]:
    """Misfit (n, G) of points z (n, 3) of frames (n,), at canonical, to the body's points of each of the target frames,
    and the one of these points that fits best, `NONE` or `HERE`."""
    targets = evidence_frames(len(body.T), EVIDENCE_FRAMES) if targets is None else targets
    slot = np.full(len(body.T), NONE)
    slot[targets] = np.arange(len(targets))
    members, own = np.flatnonzero(slot[body.frame] >= 0), slot[frame]
    cells = sort_into_cells(body.z[members], REACH)
    row = members[cells.order]
    cloud = np.ascontiguousarray(np.concatenate([body.z[row], body.normals[row]], axis=1).T)
    misfit, partner = np.full((len(z), len(targets)), np.inf), np.full((len(z), len(targets)), NONE)
    here = np.flatnonzero(own >= 0)
    misfit[here, own[here]], partner[here, own[here]] = 0.0, HERE
    place, order = cells.around(z)
    _best_partners(
        z, order, place, cells.start, cells.shape, cloud, slot[body.frame[row]], row, noise, WITHIN, REACH,
        misfit, partner,
    )  # fmt: skip
    return np.minimum(misfit, DENIED), partner


def others(partner: Int[Array, "n G"]) -> Int[Array, " n"]:
    """(n,) how many of the target frames of partners (n, G) are not the point's own; 1 at least."""
    return np.maximum((partner != HERE).sum(axis=1), 1)


def misfits(z: Float[Array, "n 3"], frame: Int[Array, " n"], body: Body, noise: float) -> Float[Array, " n"]:
    """(n,) mean misfit over the other frames of points z (n, 3) of frames (n,), at canonical, if they were the
    body's."""
    misfit, partner = partners(z, frame, body, noise)
    return misfit.sum(axis=1) / others(partner)


def own_misfits(body: Body, noise: float, asked: Int[Array, " n"] | slice = slice(None)) -> Float[Array, " n"]:
    """(n,) of the body's own points, or of those asked."""
    return misfits(body.z[asked], body.frame[asked], body, noise)


def shares(frames: Frames, body: Body, asked: Int[Array, " n"] | slice = slice(None)) -> Float[Array, "n G"]:
    """(n, G) what each of the frames adds to the mean misfit of the body's own points, or of those asked; nan where a
    frame cannot tell: it is the point's own, or has nothing there and sees no further."""
    targets = evidence_frames(len(body.T), EVIDENCE_FRAMES)
    z, frame = body.z[asked], body.frame[asked]
    misfit, partner = partners(z, frame, body, frames.noise, targets)
    misfit /= others(partner)[:, None]
    misfit[partner == HERE] = np.nan
    if frames.views is not None:
        i, g = np.nonzero(partner == NONE)
        f = np.asarray(targets)[g]
        blind = frames.views.blind(transform_by(body.T, f, z[i]), f)
        misfit[i[blind], g[blind]] = np.nan
    return misfit


def growth(before: Float[Array, "n G"], after: Float[Array, "n G"]) -> Float[Array, " n"]:
    """(n,) by how much the misfit of each point grows, of `shares` (n, G) before and after, over the frames that tell
    of both: where a surface could not be seen, neither to hide there nor to come forth is worth anything."""
    return np.nansum(after - before, axis=1)


def doubt(grown: Float[Array, " n"]) -> float:
    """How far the sum of the growth (n,) of points may be from what it is for other draws of them (Vuong 1989): `SURE`
    standard errors. Points share partners, so that these come out somewhat too small."""
    return SURE * float(np.sqrt((grown * grown).sum()))


def grown_with(grown: Float[Array, " n"], more: int) -> float:
    """The sum of the growth of points where that comes with so many more bodies: in doubt, fewer are right."""
    return float(grown.sum() + np.sign(more) * doubt(grown))


def total(found: Float[Array, "n G"], frame: Int[Array, " n"], F: int) -> float:
    """Misfit of points of frames (n,), of F, from their `shares` (n, G): what a frame cannot tell of is denied."""
    own = frame[:, None] == np.array(evidence_frames(F, EVIDENCE_FRAMES))
    blind = np.isnan(found) & ~own
    return float(np.nansum(found) + (DENIED * blind.sum(axis=1) / np.maximum((~own).sum(axis=1), 1)).sum())


def denied(misfit: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """What counts of misfits where surfaces that slide in themselves are to be told: only that nothing is near."""
    return np.maximum(misfit - VAGUE, 0.0) * (DENIED / (DENIED - VAGUE))


def denials(body: Body, noise: float) -> Float[Array, " n"]:
    """(n,) what counts of the misfits of a body's own points (`denied`), mean over the other frames."""
    misfit, partner = partners(body.z, body.frame, body, noise)
    return denied(misfit).sum(axis=1) / others(partner)


@dataclass(frozen=True)
class Pairs:
    """Points of a body and their partners in other frames: numbers here (m,), there (m,) of both, and weight (m,), by
    which the pairs of a point count as one observation in all, half of it for the partners' frames."""

    here: Int[Array, " m"]
    there: Int[Array, " m"]
    weight: Float[Array, " m"]


def find_pairs(body: Body, sigma: float, stride: int = 1) -> Pairs:
    """sigma: robust scale of a registration. stride: every stride-th point is asked, and counts for as many."""
    z, frame = body.z[::stride], body.frame[::stride]
    partner = partners(z, frame, body, max(2 * NOISE_FLOOR, sigma / 3))[1]
    i, g = np.nonzero(partner >= 0)
    return Pairs(i * stride, partner[i, g], 0.5 * stride / others(partner)[i])


def pair_equations(
    body: Body, sigma: float, pairs: Pairs | None = None
) -> tuple[Float[Array, "F 6 6"], Float[Array, "F 6"]]:
    """Normal equations H (F, 6, 6), g (F, 6) of left twists, at canonical, of every frame's points onto the planes of
    their partners. sigma: robust scale. pairs: those of all points where not given."""
    pairs = find_pairs(body, sigma) if pairs is None else pairs
    here, there, F = pairs.here, pairs.there, len(body.T)
    z, other, n = body.z[here], body.z[there], body.normals[there]
    gap = z - other
    w = geman_mcclure(np.einsum("ni,ni->n", gap, n) ** 2 + POINT_SHARE * np.einsum("ni,ni->n", gap, gap), sigma)
    w *= pairs.weight
    H_here, g_here = normal_equations(z, other, n, w, POINT_WEIGHT * w, body.frame[here], F)
    H_there, g_there = normal_equations(other, z, n, w, POINT_WEIGHT * w, body.frame[there], F)
    return H_here + H_there, g_here + g_there


def register(
    frames: Frames, canonical: int, body: Body, sigmas: Sequence[float], asked: int = ASKED, renew: bool = True
) -> Body:
    """The motion under which every frame's points lie on those of the other frames.

    sigmas: robust scales of a point. asked: so many points take part, about. renew: with new normals at the end.
    """
    F, stride = frames.n_frames, max(1, len(body) // asked)
    before = body
    for sigma in sigmas:
        for k in range(INNER):
            if k % HELD == 0:
                pairs = find_pairs(body, sigma, stride)
            step = (F - 1) / F * solve_twists(*pair_equations(body, sigma, pairs))  # all frames move at once
            D = exp_se3(np.clip(step, -MAX_STEP, MAX_STEP))
            D = inverse(D[canonical]) @ D
            body = body.moved(body.T @ inverse(D))
            if np.abs(step).max() < CONVERGED:
                break
    return renewed(body, before) if renew else body


def renewed(body: Body, before: Body | None = None) -> Body:
    """The body with new normals. What was known of one of mostly the same points still holds where these have hardly
    moved since; if they are all the same, so do the normals."""
    if len(body) < LEAST:
        return replace(body, normals=plane_layers(body.z)[1])
    planes = find_planes(body.z) if before is None else _known_planes(body, before)
    if before is not None and planes is before.planes:
        return replace(body, planes=planes)
    return replace(body, normals=plane_layers(body.z, planes)[1], planes=planes)


def _known_planes(body: Body, before: Body) -> Planes:
    """Those of the body; that of before where nothing has changed."""
    place = np.full(1 + max(body.rows.max(), before.rows.max(initial=0)), NONE)
    place[before.rows] = np.arange(len(before))
    place = place[body.rows]
    kept = place >= 0
    gap = body.z[kept] - before.z[place[kept]]
    way = float(np.linalg.norm(gap, axis=1).mean()) if kept.any() else np.inf
    if before.planes is None or way > STAYED:
        return find_planes(body.z)
    if way <= STILL and kept.all() and len(body) == len(before):
        return before.planes
    return keep_planes(body.z, before.planes, place, way > STILL)


def alike(a: Body, b: Body) -> bool:
    """Have the two nearly the same points and the same motion?"""
    common, i, j = np.intersect1d(a.rows, b.rows, assume_unique=True, return_indices=True)
    if len(common) < SAME * max(len(a), len(b)):
        return False
    return len(common) == 0 or float(np.linalg.norm(a.z[i] - b.z[j], axis=1).mean()) < STAYED
