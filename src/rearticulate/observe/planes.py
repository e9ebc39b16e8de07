"""Tangent planes and flat layers of clouds in which sheets lie closer to each other than points of one sheet do.

The plane of a point is the one through it and two neighbours that most neighbours lie in (RANSAC, Fischler & Bolles
1981), made better by reweighted least squares. A layer is a region that grows within a thin slab (Rabbani et al.
2006); its points have the normals of the quadratic surface through all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.nearest import nearest, search_tree

NEIGHBOURS = 24
PLANE_NEIGHBOURS = 20  # that vote for the plane of a point
TRIES = 24  # planes, at most
ENOUGH = 0.9  # share of the votes that ends the tries
NEAREST = 4  # neighbours that tell what points deviate by
THICKNESS = 0.2  # spacings; half of a sheet: what lies within it votes
SLAB = 0.1  # spacings; half of the slab that a layer grows in
STEP = 2.5  # spacings; points of a layer are connected by steps as long as this
PASSES = 5  # of growing and fitting
SMALLEST = 8  # points of a layer
MANY = 20  # points of a layer tell its normal
CURVED = 2.0


@numba.njit(cache=True, nogil=True)
def _approach_smallest(C, n):
    """Turn n towards the direction of least spread of the scatter matrix C: inverse iteration with its adjugate."""
    ridge = 1e-6 * (C[0, 0] + C[1, 1] + C[2, 2]) + 1e-12
    a, b, c, d, e, f = C[0, 0] + ridge, C[1, 0], C[1, 1] + ridge, C[2, 0], C[2, 1], C[2, 2] + ridge
    A, B, D = c * f - e * e, d * e - b * f, b * e - c * d
    E, F, G = a * f - d * d, b * d - a * e, a * c - b * b
    for _ in range(4):
        x, y, z = A * n[0] + B * n[1] + D * n[2], B * n[0] + E * n[1] + F * n[2], D * n[0] + F * n[1] + G * n[2]
        length = (x * x + y * y + z * z) ** 0.5
        n[0], n[1], n[2] = x / length, y / length, z / length


@numba.njit(cache=True, nogil=True)
def _scatter_of_sheet(w, n, thickness, C):
    """Scatter C of the offsets w (K, 3) that lie near the plane of normal n, weighted by how near."""
    mean, total = np.zeros(3), 0.0
    weight = np.zeros(len(w))
    for m in range(len(w)):
        d = (n[0] * w[m, 0] + n[1] * w[m, 1] + n[2] * w[m, 2]) / thickness
        if abs(d) < 2.0:
            weight[m] = 1.0 / (1.0 + d * d)
            total += weight[m]
            for c in range(3):
                mean[c] += weight[m] * w[m, c]
    C[:] = 0.0
    for m in range(len(w)):
        if weight[m] > 0:
            for c in range(3):
                for e in range(c + 1):
                    C[c, e] += weight[m] * (w[m, c] - mean[c] / total) * (w[m, e] - mean[e] / total)


@numba.njit(cache=True, nogil=True)
def first_state(i):
    """Of the random numbers of point i: the same in every run."""
    return np.uint64(88172645463325252) + np.uint64(i) * np.uint64(2654435761)


@numba.njit(cache=True, nogil=True)
def draw_pair(state, n):
    """The next state (xorshift, Marsaglia 2003), and two of n."""
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    state ^= state << np.uint64(17)
    return state, np.int64((state >> np.uint64(11)) % np.uint64(n)), np.int64((state >> np.uint64(37)) % np.uint64(n))


@numba.njit(cache=True, nogil=True)
def _planes(points, asked, near, thickness, tries, share):
    K = near.shape[1]
    enough = share * K
    out = np.zeros((len(asked), 3))
    w, n, C = np.empty((K, 3)), np.empty(3), np.empty((3, 3))
    for i in range(len(asked)):
        for m in range(K):
            for c in range(3):
                w[m, c] = points[near[i, m], c] - points[asked[i], c]
        state = first_state(asked[i])
        best, n[0], n[1], n[2] = 0.0, 0.0, 0.0, 1.0
        for _ in range(tries):
            state, a, b = draw_pair(state, K)
            x = w[a, 1] * w[b, 2] - w[a, 2] * w[b, 1]
            y = w[a, 2] * w[b, 0] - w[a, 0] * w[b, 2]
            z = w[a, 0] * w[b, 1] - w[a, 1] * w[b, 0]
            length = (x * x + y * y + z * z) ** 0.5
            sides = (w[a, 0] ** 2 + w[a, 1] ** 2 + w[a, 2] ** 2) * (w[b, 0] ** 2 + w[b, 1] ** 2 + w[b, 2] ** 2)
            if length < 0.35 * sides**0.5 or length < 1e-9:
                continue
            x, y, z = x / length, y / length, z / length
            support = 0.0
            for m in range(K):
                d = (x * w[m, 0] + y * w[m, 1] + z * w[m, 2]) / thickness
                support += max(1.0 - d * d, 0.0)
            if support > best:
                best, n[0], n[1], n[2] = support, x, y, z
                if best > enough:
                    break
        for _ in range(2):
            _scatter_of_sheet(w, n, thickness, C)
            _approach_smallest(C, n)
        out[i] = n
    return out


def plane_normals(
    points: Float[Array, "N 3"], near: Int[Array, "N K"] | None = None, thickness: float = THICKNESS
) -> Float[Array, "N 3"]:
    """Unit normals of unknown sign of points, three at least. near: their neighbours, if known."""
    if near is None:
        near = nearest(search_tree(points), points, k=min(PLANE_NEIGHBOURS + 1, len(points)))[1][:, 1:]
    every = np.arange(len(points))
    return _planes(np.ascontiguousarray(points), every, near[:, :PLANE_NEIGHBOURS], thickness, TRIES, ENOUGH)


def neighbour_offsets(points: Float[Array, "N 3"]) -> Float[Array, " k"]:
    """Distances of the nearest points from the plane of each point of a cloud, in any order."""
    if len(points) < 4:
        return np.zeros(0)
    near = nearest(search_tree(points), points, k=min(PLANE_NEIGHBOURS + 1, len(points)))[1][:, 1:]
    gap = points[near[:, :NEAREST]] - points[:, None]
    return np.abs(np.einsum("nki,ni->nk", gap, plane_normals(points, near))).ravel()


@numba.njit(cache=True, nogil=True)
def _spread(points, near, layer, seed, centre, normal, slab, step, mark, stamp, member):
    """The free points of the slab that steps lead to from the seed: how many, in `member`, which is the queue, too."""
    member[0], mark[seed], size, done = seed, stamp, 1, 0
    while done < size:
        i = member[done]
        done += 1
        for h in range(near.shape[1]):
            j = near[i, h]
            if mark[j] == stamp or layer[j] >= 0:
                continue
            away, d = 0.0, 0.0
            for c in range(3):
                away += (points[j, c] - points[i, c]) ** 2
                d += normal[c] * (points[j, c] - centre[c])
            if away < step * step and abs(d) < slab:
                mark[j], member[size] = stamp, j
                size += 1
    return size


@numba.njit(cache=True, nogil=True)
def _fit_plane(points, member, size, centre, normal):
    """Move centre and normal to the plane of the members."""
    C = np.zeros((3, 3))
    centre[:] = 0.0
    for k in range(size):
        centre += points[member[k]] / size
    for k in range(size):
        for a in range(3):
            for b in range(a + 1):
                C[a, b] += (points[member[k], a] - centre[a]) * (points[member[k], b] - centre[b])
    _approach_smallest(C, normal)


@numba.njit(cache=True, nogil=True)
def _grow(points, normals, near, order, slab, step, passes, smallest):
    """Layers (n,), -1 for none, each grown from the first free point in `order`."""
    n = len(points)
    layer, mark, member = np.full(n, -1), np.zeros(n, np.int64), np.empty(n, np.int64)
    stamp, count = 0, 0
    for seed in order:
        if layer[seed] >= 0:
            continue
        centre, normal, size = points[seed].copy(), normals[seed].copy(), 0
        for turn in range(passes):
            stamp += 1
            size = _spread(points, near, layer, seed, centre, normal, slab, step, mark, stamp, member)
            if turn == passes - 1 or size < smallest:
                break
            _fit_plane(points, member, size, centre, normal)
        if size >= smallest:
            layer[member[:size]] = count
            count += 1
    return layer


@dataclass(frozen=True)
class Planes:
    """Of N points, four at least: near (N, K), rows of the nearest others of the cloud, and normals (N, 3) of the
    planes through them that most of these lie in."""

    near: Int[Array, "N K"]
    normals: Float[Array, "N 3"]


def find_planes(points: Float[Array, "N 3"]) -> Planes:
    """Of a cloud."""
    near = nearest(search_tree(points), points, k=min(NEIGHBOURS + 1, len(points)))[1][:, 1:]
    return Planes(near, _planes_at(points, np.arange(len(points)), near))


def keep_planes(points: Float[Array, "N 3"], old: Planes, place: Int[Array, " N"], again: bool) -> Planes:
    """As `find_planes`, of a cloud of mostly the points of an old one. place: of each in that, -1 of new ones.

    What the old planes tell still holds but for points that lost a neighbour, or to which a new point came nearer.
    again: new normals for all.
    """
    K = min(NEIGHBOURS, len(points) - 1)
    if old.near.shape[1] != K:
        return find_planes(points)
    new, kept = place < 0, np.flatnonzero(place >= 0)
    now = np.full(len(old.near), -1)
    now[place[kept]] = kept
    near, normals = np.full((len(points), K), -1), np.zeros((len(points), 3))
    near[kept], normals[kept] = now[old.near[place[kept]]], old.normals[place[kept]]
    stale = (near < 0).any(axis=1)
    if new.any():
        radius = np.linalg.norm(points[near[:, -1]] - points, axis=1)
        stale |= nearest(search_tree(points[new]), points, within=float(radius[~stale].max(initial=0.0)))[0] < radius
    asked = np.flatnonzero(stale)
    if len(asked):
        near[asked] = nearest(search_tree(points), points[asked], k=K + 1)[1][:, 1:]
    asked = np.arange(len(points)) if again else asked
    normals[asked] = _planes_at(points, asked, near[asked])
    return Planes(near, normals)


def _planes_at(points: Float[Array, "N 3"], asked: Int[Array, " n"], near: Int[Array, "n K"]) -> Float[Array, "n 3"]:
    return _planes(points, asked, near[:, :PLANE_NEIGHBOURS], 2 * SLAB, TRIES, ENOUGH)


def plane_layers(
    points: Float[Array, "N 3"], planes: Planes | None = None
) -> tuple[Int[Array, " N"], Float[Array, "N 3"]]:
    """Layer of every point of a cloud, -1 for none, and normals: of layers, or of single planes.
    Lengths in spacings. planes: if known. Fewer than four points have no layers and any normals."""
    if len(points) < 4:
        return np.full(len(points), -1), np.tile([0.0, 0.0, 1.0], (len(points), 1))
    points = np.ascontiguousarray(points)
    planes = find_planes(points) if planes is None else planes
    normals, order = planes.normals.copy(), np.random.default_rng(0).permutation(len(points))
    layer = _grow(points, normals, planes.near, order, SLAB, STEP, PASSES, SMALLEST)
    _smooth(points, layer, MANY, CURVED, normals)
    return layer, normals


@numba.njit(cache=True, nogil=True)
def _smooth(points, layer, many, curved, normals):
    """Give the points of every layer (n,) that has enough of them the normals of its surface."""
    order = np.argsort(layer, kind="mergesort")
    first = 0
    while first < len(order):
        last = first
        while last < len(order) and layer[order[last]] == layer[order[first]]:
            last += 1
        if layer[order[first]] >= 0 and last - first >= many:
            rows = order[first:last]
            normals[rows] = surface_normals(points[rows], curved)
        first = last


@numba.njit(cache=True, nogil=True)
def surface_normals(points, curved=CURVED):
    """(n, 3) unit normals of a nearly flat set of points (n, 3): of its plane, or of the quadratic height over it where
    that leaves less than 1 / curved of the squared deviations."""
    n, centre = len(points), np.zeros(3)
    for i in range(n):
        centre += points[i] / n
    centred = points - centre
    axes = np.linalg.eigh(centred.T @ centred)[1]
    local = centred @ axes
    z, x, y = local[:, 0].copy(), local[:, 1].copy(), local[:, 2].copy()
    terms = np.empty((n, 6))
    terms[:, 0], terms[:, 1], terms[:, 2], terms[:, 3], terms[:, 4], terms[:, 5] = 1.0, x, y, x * x, x * y, y * y
    gram = terms.T @ terms
    fitted = np.linalg.solve(gram + 1e-12 * np.trace(gram) * np.eye(6), terms.T @ z)
    out = np.empty((n, 3))
    if curved * np.sum((terms @ fitted - z) ** 2) > np.sum(z**2):
        for i in range(n):
            out[i] = axes[:, 0]
        return out
    for i in range(n):
        u = -(fitted[1] + 2 * fitted[3] * x[i] + fitted[4] * y[i])
        v = -(fitted[2] + fitted[4] * x[i] + 2 * fitted[5] * y[i])
        length = (1 + u * u + v * v) ** 0.5
        for c in range(3):
            out[i, c] = (axes[c, 0] + u * axes[c, 1] + v * axes[c, 2]) / length
    return out
