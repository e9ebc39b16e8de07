"""Joint values, root pose and labels for new scans of an object whose model is known: no correspondences are given.

Every scan starts from all recorded postures, from the one found before, from the matches of the network and from a
search along the tree; the starts that fit best are registered, points to planes both ways, under a robust scale that
shrinks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rearticulate.errors import InputError
from rearticulate.geometry.kinematics import forward_kinematics
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import from_unit, rotate, to_unit, transform
from rearticulate.localization.beam_search import Target, Tree, beam_search, sampled
from rearticulate.localization.descent import pair_weights, stepped
from rearticulate.observe.frames import Frames, make_frames
from rearticulate.observe.register import match, normal_equations
from rearticulate.parts.matched_starts import MatchedStarts
from rearticulate.posing.fuse import fuse
from rearticulate.posing.single import SingleValued, single_valued
from rearticulate.records import FitResult, KinematicModel, Motion, PointSequence, Posture
from rearticulate.retargeting.retarget import retarget

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

BUDGET = 8000  # points of the model, from all its frames
MATCHES = 400  # of the network, that lead one start
FEW = 600  # points that choose among the starts
STARTS = 6  # that are registered
ROUNDS = 24
SIGMA, SIGMA_END = 8.0, 0.56  # robust scale of a point, first and last, in spacings
CAP = 3.0  # spacings; a point that is farther off counts as this far


@dataclass(frozen=True)
class Localization:
    """motion: q (F, D), T_world_root (F, 4, 4). labels: one (N_f,) array a scan. residual: (F,) mean distance of each
    scan's points to the model, m."""

    motion: Motion
    labels: tuple[IntArray, ...]
    residual: Array


def track(
    result: FitResult,
    recorded: PointSequence,
    scans: PointSequence,
    progress: Callable[[float], None] = lambda share: None,
) -> Localization:
    """Postures of new scans of the object of a result. recorded: the sequence it was fitted to.

    Raises InputError on a scan with fewer than 50 points.
    """
    single = single_valued(result.model)
    q_seen, root_seen = single.hinges(result.motion.q), result.motion.T_world_root
    points, labels = thinned_body(result, recorded, single)
    q, roots, found, residual = [], [], [], []
    for f, cloud in enumerate(scans.points):
        if len(cloud) < 50:
            raise InputError(f"{scans.names[f]}: {len(cloud)} points are too few, at least 50 are needed")
        scan = Scan(single.model, make_frames([points, cloud]), labels)
        starts = [scan.posture(*seen) for seen in zip([*q[-1:], *q_seen], [*roots[-1:], *root_seen], strict=True)]
        best = scan.register(starts)
        q_own, root = scan.metric(best)
        q.append(q_own)
        roots.append(root)
        own, distance = scan.labels_of_scan(best)
        found.append(np.searchsorted(single.number, own))
        residual.append(float(distance.mean()))
        progress((f + 1) / len(scans))
    motion = Motion(np.array([single.back(row) for row in q]), np.array(roots))
    return Localization(motion, tuple(found), np.array(residual))


def followed(result: FitResult, scans: PointSequence, found: Localization) -> tuple[FitResult, PointSequence]:
    """A result and its sequence for all that shows or writes one: frame 0 is the canonical frame, then come the scans.

    The observed ranges grow by what the scans show.
    """
    model, rest = result.model, Posture.rest(result.model)
    q = np.concatenate([rest.q[None], found.motion.q])
    motion = Motion(q, np.concatenate([rest.T_world_root[None], found.motion.T_world_root]))
    angle = [
        np.linalg.norm(q[:, model.values(j)], axis=1) if kind == "spherical" else q[:, j]
        for j, kind in enumerate(model.joint_type)
    ]
    low, high = np.min(angle, axis=1), np.max(angle, axis=1)
    limits = np.stack([np.minimum(model.limits[:, 0], low), np.maximum(model.limits[:, 1], high)], axis=1)
    sequence = PointSequence(
        (model.points, *scans.points), (np.arange(len(model.points)), *scans.index), ("rest pose", *scans.names)
    )
    return replace(
        result,
        model=replace(model, canonical=0, limits=limits),
        motion=motion,
        labels=(model.labels, *found.labels),
        energies={},
        residual=np.concatenate([result.residual[[model.canonical]], found.residual]),
        stages=(),
        relaxed=None,
    ), sequence


def thinned_body(result: FitResult, recorded: PointSequence, single: SingleValued) -> tuple[Array, IntArray]:
    """At most BUDGET points (n, 3) of all frames in the canonical pose, and their links (n,)."""
    clouds = fuse(result, recorded)
    points = np.concatenate(clouds)
    labels = np.repeat(single.number, [len(cloud) for cloud in clouds])
    rows = np.random.default_rng(0).permutation(len(points))[:BUDGET]
    return points[rows], labels[rows]


@dataclass(frozen=True)
class Scan:
    """A model and one scan, as frames 0 and 1, in whose units all postures are. link: (n,) link of each model point, as
    they were given."""

    model: KinematicModel
    frames: Frames
    link: IntArray

    @cached_property
    def body(self) -> tuple[Array, Array, IntArray]:
        """Points, normals and links of the model."""
        rows = self.frames.rows(0)
        return self.frames.points[rows], self.frames.normals[rows], self.link[self.frames.order[rows]]

    @cached_property
    def cloud(self) -> tuple[Array, Array]:
        """Points and normals of the scan."""
        rows = self.frames.rows(1)
        return self.frames.points[rows], self.frames.normals[rows]

    @cached_property
    def twists(self) -> Array:
        """(P, 6) of the model in the units of the frames."""
        twists = self.model.twists.copy()
        origin = (self.model.origin - self.frames.centre) / self.frames.unit
        turning = twists[:, :3].any(axis=1)
        twists[turning, 3:] = np.cross(origin[turning], self.model.axis[turning])
        return twists

    @cached_property
    def slides(self) -> NDArray[np.bool_]:
        return np.array([kind == "prismatic" for kind in self.model.joint_type])

    def posture(self, q: Array, T_world_root: Array) -> Posture:
        """From metres and radians."""
        unit, centre = self.frames.unit, self.frames.centre
        return Posture(np.where(self.slides, q / unit, q), to_unit(T_world_root, unit, centre))

    def metric(self, posture: Posture) -> tuple[Array, Array]:
        """Back to metres and radians."""
        unit, centre = self.frames.unit, self.frames.centre
        return np.where(self.slides, posture.q * unit, posture.q), from_unit(posture.T_world_root, unit, centre)

    def forward(self, posture: Posture) -> Array:
        """(P, 4, 4) poses of the links."""
        return forward_kinematics(self.model.parent, self.twists, posture.q, posture.T_world_root)

    def register(self, starts: list[Posture]) -> Posture:
        """The posture that fits the scan best."""
        led = self.led_by_network()
        starts = starts + led + self.searched([*starts[:1], *led])
        starts = sorted(starts, key=lambda start: self.misfit(start, FEW))[:STARTS]
        return min([self.refined(start) for start in starts], key=self.misfit)

    def searched(self, roots: list[Posture]) -> list[Posture]:
        """What a search along the tree finds from some root poses."""
        limits = np.where(self.slides[:, None], self.model.limits / self.frames.unit, self.model.limits)
        tree = Tree(self.model.parent, self.twists, limits, *sampled(*self.body, self.model.n_parts))
        target = Target(self.frames.trees[1], self.cloud[1])
        q, root = beam_search(tree, target, np.array([posture.T_world_root for posture in roots]))
        return [Posture(*found) for found in zip(q, root, strict=True)]

    def led_by_network(self) -> list[Posture]:
        """Where the matches of the correspondence network lead, if both clouds have enough points for it."""
        matched = MatchedStarts(self.frames)
        if not matched.possible(0, 1):
            return []
        flow = matched.flow(0, 1)
        rows = np.random.default_rng(0).permutation(len(flow.anchors))[:MATCHES]
        unit, centre = self.frames.unit, self.frames.centre
        source, vector = flow.anchors[rows] * unit + centre, flow.vectors[rows] * unit
        points, _, link = self.body
        own = link[nearest(search_tree(points), flow.anchors[rows])[1]]
        found = retarget(self.model, source, source + vector, part=own)
        return [self.posture(found.q, found.T_world_root)]

    def refined(self, posture: Posture) -> Posture:
        """Gauss-Newton rounds with new counterparts in each."""
        for i in range(ROUNDS):
            sigma = SIGMA * (SIGMA_END / SIGMA) ** (i / (ROUNDS - 1))
            posture = self.step(posture, sigma)
        return posture

    def step(self, posture: Posture, sigma: float) -> Posture:
        """One damped step of joint values and root pose."""
        T = self.forward(posture)
        H, g = self.equations(T, sigma)
        return Posture(*stepped(self.model.parent, self.twists, posture.q, posture.T_world_root, T, H, g))

    def equations(self, T: Array, sigma: float) -> tuple[Array, Array]:
        """Normal equations H (P, 6, 6), g (P, 6) over left twists of the links: model onto scan, scan onto model."""
        x, nx, link = self.body
        cloud, normals = self.cloud
        y, ny = transform(T[link], x), rotate(T[link], nx)
        z, nz, d, r, agreement = match(self.frames.trees[1], normals, y, ny)
        w = pair_weights(r, d, agreement, sigma)
        H, g = normal_equations(y, z, nz, w, 0.1 * w, link, len(T))
        d, j = nearest(search_tree(y), cloud)
        r, agreement = np.einsum("ij,ij->i", y[j] - cloud, normals), np.abs(np.einsum("ij,ij->i", ny[j], normals))
        w = pair_weights(r, d, agreement, sigma)
        H2, g2 = normal_equations(y[j], cloud, normals, w, 0.1 * w, link[j], len(T))
        return H + H2, g + g2

    def misfit(self, posture: Posture, count: int | None = None) -> float:
        """Mean capped distance both ways, of all points or of `count`."""
        x, _, link = self.body
        cloud, _ = self.cloud
        y = transform(self.forward(posture)[link], x)
        some = slice(None, None, 1 if count is None else max(1, len(y) // count))
        here = nearest(self.frames.trees[1], y[some], within=CAP)[0]
        some = slice(None, None, 1 if count is None else max(1, len(cloud) // count))
        there = nearest(search_tree(y), cloud[some], within=CAP)[0]
        return float(np.minimum(here, CAP).mean() + np.minimum(there, CAP).mean())

    def labels_of_scan(self, posture: Posture) -> tuple[IntArray, Array]:
        """Link (N,) of every point of the scan in the scan's own order, and its distance to the model, m."""
        x, _, link = self.body
        cloud, _ = self.cloud
        d, j = nearest(search_tree(transform(self.forward(posture)[link], x)), cloud)
        own = self.frames.order[self.frames.rows(1)] - len(x)
        labels, distance = np.empty(len(cloud), dtype=np.int64), np.empty(len(cloud))
        labels[own], distance[own] = link[j], d * self.frames.unit
        return labels, distance
