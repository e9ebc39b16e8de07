"""Motion between frames: overlapping rigid patches of the canonical cloud, followed from frame to frame.

Embedded deformation with robust as-rigid-as-possible edges (Sumner et al. 2007, Li et al. 2009), matched both ways:
patch to frame and frame to patch. The second direction keeps a fast limb from collapsing onto the body, and the wide
start of the robust scale gives the large capture range. Where it is known from where the points were taken, what a
frame hides has no say: hidden patches go where their neighbours go.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np

from rearticulate.arrays import Array, Bool, Float, Int
from rearticulate.config import FitConfig
from rearticulate.geometry.nearest import farthest_points, nearest, search_tree
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import exp_se3, inverse, rotate_by, transform_by
from rearticulate.observe.frames import Frames
from rearticulate.observe.register import match, normal_equations
from rearticulate.observe.views import HIDDEN
from rearticulate.parts.matched_starts import MatchedStarts

DAMPING = np.diag([0.035] * 3 + [1e-4] * 3)
POINTS_PER_NODE = 12.8
MIN_NODES, MAX_NODES = 160, 360
PATCH_SIZE = 30  # points
EDGES_PER_NODE = 6
ITERATIONS = 30
SIGMA_END = 0.75  # spacings; robust scale of a correspondence in the last iteration, in the first: the capture range
STIFFNESS, STIFFNESS_END = 3.0, 0.02  # weight of a patch edge, relative to the data of one patch
TEAR, TEAR_END = 9.3, 1.9  # spacings; robust scale of the gap of an edge
TEAR_MEMORY = 3.7  # spacings; an edge that was torn by more than this in another frame stays weak
POINT_SHARE = 0.3  # of the distance to the point, against that to its plane
BAD_COST = 2.15  # spacings; a frame with a larger two-sided distance is tried again from others ...
UNUSUAL = 1.08  # ... and one with so many times the usual distance
EXPLAINED = 1.0  # spacings; a place that is as near to a point of the frame is seen
UNSEEN = 1.0  # spacings; distance of a point that cannot be seen: above that of most that are
GAIN = 0.02  # spacings; a start is taken if it lowers that distance by this (standard error 0.012, 4096 points)


@dataclass(frozen=True)
class Patches:
    """Rigid patches of the canonical cloud, that of frame `canonical`.

    points, normals: the canonical cloud. owner: patch of each point. member, patch: the overlapping membership list.
    weight: one over the patch's size. edge_i, edge_j: neighbouring patches, joined at anchors.
    """

    canonical: int
    points: Float[Array, "N 3"]
    normals: Float[Array, "N 3"]
    owner: Int[Array, " N"]
    member: Int[Array, " m"]
    patch: Int[Array, " m"]
    weight: Float[Array, " m"]
    edge_i: Int[Array, " E"]
    edge_j: Int[Array, " E"]
    anchors: Float[Array, "E 4 3"]

    @property
    def count(self) -> int:
        return int(self.owner.max()) + 1


@dataclass(frozen=True)
class Tracks:
    """T_frame_patch of every patch in every frame; identity at the canonical frame."""

    patches: Patches
    T: Float[Array, "F K 4 4"]


def make_patches(points: Float[Array, "N 3"], normals: Float[Array, "N 3"], canonical: int = 0) -> Patches:
    """Patches around farthest-point nodes; every point belongs to at least one."""
    count = int(np.clip(len(points) / POINTS_PER_NODE, MIN_NODES, MAX_NODES))
    nodes = points[farthest_points(points, min(count, len(points) // 4))]
    K, tree = len(nodes), search_tree(points)
    size = min(PATCH_SIZE, len(points))
    owner = nearest(search_tree(nodes), points)[1]
    member = nearest(tree, nodes, k=size)[1].ravel()
    patch = np.repeat(np.arange(K), size)
    missing = np.setdiff1d(np.arange(len(points)), member)
    member, patch = np.concatenate([member, missing]), np.concatenate([patch, owner[missing]])
    order = np.argsort(patch, kind="stable")
    member, patch = member[order], patch[order]
    k = min(EDGES_PER_NODE, K - 1)
    neighbour = nearest(search_tree(nodes), nodes, k=k + 1)[1][:, 1:]
    edges = np.unique(np.sort(np.stack([np.repeat(np.arange(K), k), neighbour.ravel()], 1), axis=1), axis=0)
    a, b = nodes[edges[:, 0]], nodes[edges[:, 1]]
    corner = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
    reach = 0.5 * np.linalg.norm(a - b, axis=1).mean()
    return Patches(
        canonical=canonical,
        points=points,
        normals=normals,
        owner=owner,
        member=member,
        patch=patch,
        weight=1.0 / np.bincount(patch, minlength=K)[patch],
        edge_i=edges[:, 0].copy(),
        edge_j=edges[:, 1].copy(),
        anchors=(a + b)[:, None] / 2 + reach * corner,
    )


@numba.njit(cache=True, nogil=True)
def edge_blocks(T, edge_i, edge_j, anchors, w, H, off, g):
    """Add sum_e w_e sum_k |T_i p_k - T_j p_k|^2 to the diagonal blocks H and to g; set the off-diagonal blocks (i, j).

    Returns (E,) the mean squared gap of each edge.
    """
    gap = np.zeros(len(edge_i))
    a, b = np.empty(3), np.empty(3)
    Ji, Jj = np.zeros((3, 6)), np.zeros((3, 6))
    for e in range(len(edge_i)):
        i, j, we = edge_i[e], edge_j[e], w[e]
        off[e] = 0.0
        for k in range(anchors.shape[1]):
            p = anchors[e, k]
            for r in range(3):
                a[r] = T[i, r, 0] * p[0] + T[i, r, 1] * p[1] + T[i, r, 2] * p[2] + T[i, r, 3]
                b[r] = T[j, r, 0] * p[0] + T[j, r, 1] * p[1] + T[j, r, 2] * p[2] + T[j, r, 3]
            Ji[0, 1], Ji[0, 2], Ji[1, 0], Ji[1, 2], Ji[2, 0], Ji[2, 1] = a[2], -a[1], -a[2], a[0], a[1], -a[0]
            Jj[0, 1], Jj[0, 2], Jj[1, 0], Jj[1, 2], Jj[2, 0], Jj[2, 1] = b[2], -b[1], -b[2], b[0], b[1], -b[0]
            for r in range(3):
                Ji[r, 3 + r] = 1.0
                Jj[r, 3 + r] = 1.0
            for r in range(3):
                d = a[r] - b[r]
                gap[e] += d * d
                for u in range(6):
                    g[i, u] += we * Ji[r, u] * d
                    g[j, u] -= we * Jj[r, u] * d
                    for v in range(6):
                        H[i, u, v] += we * Ji[r, u] * Ji[r, v]
                        H[j, u, v] += we * Jj[r, u] * Jj[r, v]
                        off[e, u, v] -= we * Ji[r, u] * Jj[r, v]
    return gap / anchors.shape[1]


@numba.njit(cache=True, nogil=True)
def _apply_blocks(D, x, out):
    for k in range(D.shape[0]):
        for u in range(6):
            s = 0.0
            for v in range(6):
                s += D[k, u, v] * x[k, v]
            out[k, u] = s


@numba.njit(cache=True, nogil=True)
def conjugate_gradient(H, H_inv, off, edge_i, edge_j, b, iterations, tolerance):
    """Solve the block graph system (diagonal H, off-diagonal blocks of the edges) x = b, block-Jacobi conditioned."""
    x, r, z, q = np.zeros_like(b), b.copy(), np.zeros_like(b), np.zeros_like(b)
    _apply_blocks(H_inv, r, z)
    p = z.copy()
    rz = (r * z).sum()
    first = rz
    for _ in range(iterations):
        _apply_blocks(H, p, q)
        for e in range(len(edge_i)):
            i, j = edge_i[e], edge_j[e]
            for u in range(6):
                for v in range(6):
                    q[i, u] += off[e, u, v] * p[j, v]
                    q[j, v] += off[e, u, v] * p[i, u]
        alpha = rz / (p * q).sum()
        x += alpha * p
        r -= alpha * q
        _apply_blocks(H_inv, r, z)
        rz_new = (r * z).sum()
        if rz_new < tolerance * tolerance * first:
            break
        p = z + (rz_new / rz) * p
        rz = rz_new
    return x


def _hidden(frames: Frames, f: int, y: Float[Array, "n 3"], d: Float[Array, " n"]) -> Bool[Array, " n"]:
    """The places y, at distances d from the points of frame f, that its sensors cannot see."""
    out = np.zeros(len(y), dtype=bool)
    if frames.views is not None:
        far = np.flatnonzero(d > EXPLAINED)
        out[far] = frames.views.classes(y[far], np.full(len(far), f)) == HIDDEN
    return out


def _match_forward(
    frames: Frames, patches: Patches, f: int, T: Float[Array, "K 4 4"], sigma: float
) -> tuple[Float[Array, "K 6 6"], Float[Array, "K 6"]]:
    """Normal equations of patch points to the nearest points of frame f, but of those that it hides."""
    y = transform_by(T, patches.patch, patches.points[patches.member])
    ny = rotate_by(T, patches.patch, patches.normals[patches.member])
    z, nz, d, r, agreement = match(frames.trees[f], frames.normals[frames.rows(f)], y, ny)
    w = geman_mcclure(0.5 * (r * r + d * d), sigma) * np.where(agreement > 0.4, agreement, 0.02) * patches.weight
    w *= ~_hidden(frames, f, y, d)
    return normal_equations(y, z, nz, w, POINT_SHARE * w, patches.patch, patches.count)


def _match_backward(
    frames: Frames, patches: Patches, f: int, T: Float[Array, "K 4 4"], sigma: float
) -> tuple[Float[Array, "K 6 6"], Float[Array, "K 6"]]:
    """Normal equations of the points of frame f to their nearest patch points: what is observed must be explained,
    unless the canonical frame hides it."""
    tree, target_normals = frames.trees[f], frames.normals[frames.rows(f)]
    y = transform_by(T, patches.owner, patches.points)
    ny = rotate_by(T, patches.owner, patches.normals)
    d, j = nearest(search_tree(y), tree.data)
    agreement = np.abs(np.einsum("ij,ij->i", ny[j], target_normals))
    w = geman_mcclure(d * d, 1.5 * sigma) * np.maximum(agreement, 0.1) * 0.64 * patches.count / tree.n
    w *= ~_newly_seen(frames, patches, T, tree.data, d, j)
    return normal_equations(y[j], tree.data, target_normals, w, 0.5 * w, patches.owner[j], patches.count)


def _newly_seen(
    frames: Frames,
    patches: Patches,
    T: Float[Array, "K 4 4"],
    z: Float[Array, "n 3"],
    d: Float[Array, " n"],
    j: Int[Array, " n"],
) -> Bool[Array, " n"]:
    """The observed points z, at distances d from patch points j, that the canonical frame hides where these patches
    bring them to it."""
    if frames.views is None:
        return np.zeros(len(z), dtype=bool)
    return _hidden(frames, patches.canonical, transform_by(inverse(T), patches.owner[j], z), d)


def register_patches(
    frames: Frames,
    patches: Patches,
    f: int,
    T: Float[Array, "K 4 4"],
    edge_weight: Float[Array, " E"],
    capture_range: float,
) -> tuple[Float[Array, "K 4 4"], Float[Array, " E"]]:
    """Gauss-Newton from T onto frame f. Returns T and the squared gap of each edge.

    capture_range: robust scale of a correspondence in the first iteration, in spacings.
    """
    gap = np.zeros(len(patches.edge_i))
    off = np.empty((len(gap), 6, 6))
    for i in range(ITERATIONS):
        a = i / (ITERATIONS - 1)
        sigma = capture_range * (SIGMA_END / capture_range) ** a
        stiffness = STIFFNESS * (STIFFNESS_END / STIFFNESS) ** a
        tear = TEAR * (TEAR_END / TEAR) ** a
        H1, g1 = _match_forward(frames, patches, f, T, sigma)
        H2, g2 = _match_backward(frames, patches, f, T, sigma)
        H, g = H1 + H2 + DAMPING, g1 + g2
        w = stiffness * edge_weight * geman_mcclure(gap, tear) / 4
        gap = edge_blocks(T, patches.edge_i, patches.edge_j, patches.anchors, w, H, off, g)
        step = conjugate_gradient(H, np.linalg.inv(H), off, patches.edge_i, patches.edge_j, -g, 60, 1e-2)
        T = exp_se3(step) @ T
    return T, gap


def _two_sided_cost(frames: Frames, patches: Patches, T: Float[Array, "K 4 4"], f: int) -> float:
    y = transform_by(T, patches.owner, patches.points)
    tree = frames.trees[f]
    there, (back, j) = nearest(tree, y)[0], nearest(search_tree(y), tree.data)
    there = np.where(_hidden(frames, f, y, there), UNSEEN, np.minimum(there, 4))
    back = np.where(_newly_seen(frames, patches, T, tree.data, back, j), UNSEEN, np.minimum(back, 4))
    return float(there.mean() + back.mean())


def _register_from_starts(
    frames: Frames,
    patches: Patches,
    f: int,
    starts: Sequence[Callable[[], Float[Array, "K 4 4"]]],
    edge_weight: Float[Array, " E"],
    usual_cost: float,
    capture_range: float,
) -> tuple[Float[Array, "K 4 4"], Float[Array, " E"], float]:
    """Start from starts[0]; when the result is unusually bad, also from the others and with twice the capture range.

    starts: functions that make them, for the later ones take time.
    """
    first = starts[0]()
    T, gap = register_patches(frames, patches, f, first, edge_weight, capture_range)
    cost = _two_sided_cost(frames, patches, T, f)
    if cost > min(BAD_COST, UNUSUAL * usual_cost):
        for start, reach in [(make(), capture_range) for make in starts[1:]] + [(first, 2 * capture_range)]:
            T_new, gap_new = register_patches(frames, patches, f, start, edge_weight, reach)
            cost_new = _two_sided_cost(frames, patches, T_new, f)
            if cost_new < cost - GAIN:
                T, gap, cost = T_new, gap_new, cost_new
    return T, gap, cost


def track_patches(frames: Frames, canonical: int, config: FitConfig, progress=lambda fraction: None) -> Tracks:
    """Follow the canonical frame's patches forwards and backwards through the sequence."""
    rows = frames.rows(canonical)
    patches = make_patches(frames.points[rows], frames.normals[rows], canonical)
    F, K = frames.n_frames, patches.count
    T = np.tile(np.eye(4), (F, K, 1, 1))
    gaps = np.zeros((F, len(patches.edge_i)))
    costs: list[float] = []
    matched = MatchedStarts(frames)
    first_step = None
    for direction in (1, -1):
        previous = T[canonical]
        velocity = None if first_step is None else inverse(first_step)
        for f in range(canonical + direction, F if direction > 0 else -1, direction):
            starts: list[Callable[[], Float[Array, "K 4 4"]]] = [lambda T=previous: T]
            if velocity is not None:
                starts.insert(0, lambda T=velocity @ previous: T)
            if config.uses("network") and matched.possible(f - direction, f):
                points, patch = patches.points[patches.member], patches.patch
                starts.append(partial(matched.poses, previous, points, patch, f - direction, f))
            torn = geman_mcclure(gaps.max(axis=0), TEAR_MEMORY) + 0.01
            usual = float(np.median(costs)) if costs and velocity is not None else np.inf
            T[f], gaps[f], cost = _register_from_starts(frames, patches, f, starts, torn, usual, config.capture_range)
            costs.append(cost)
            velocity = T[f] @ inverse(previous)
            first_step = velocity if first_step is None else first_step
            previous = T[f]
            progress(len(costs) / (F - 1))
    return Tracks(patches, T)
