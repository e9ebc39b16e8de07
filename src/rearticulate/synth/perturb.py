"""Harder copies of a recording: each function maps (sequence, truth) to a new consistent (sequence, truth).

The result is a recording in its own right: `truth.labels` has one entry for every point of the new sequence. Where
points must be made up (`densify`, `interpolate`), all frames' points are fused: carried by their own part's true
motion to the wanted posture. Frames then share some surface points, which freshly sampled frames do not.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.nearest import rms_radius
from rearticulate.geometry.se3 import exp_se3, inverse, log_se3, rotate, transform
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth.trajectories import random_directions, root_walk
from rearticulate.synth.visibility import visible_points

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
Recording = tuple[PointSequence, GroundTruth]


def point_labels(sequence: PointSequence, truth: GroundTruth) -> tuple[IntArray, ...]:
    """True part of every point of the sequence, one (N_f,) array a frame."""
    return tuple(labels[index] for labels, index in zip(truth.labels, sequence.index, strict=True))


def add_noise(sequence: PointSequence, truth: GroundTruth, sigma: float, *, seed: int = 0) -> Recording:
    """Gaussian noise of standard deviation sigma (metres) on every coordinate."""
    rng = np.random.default_rng(seed)
    return _recording([p + sigma * rng.normal(size=p.shape) for p in sequence.points], sequence, truth)


def subsample(sequence: PointSequence, truth: GroundTruth, n: int, *, seed: int = 0) -> Recording:
    """At most n random points of each frame, in their old order."""
    rng = np.random.default_rng(seed)
    rows = [np.sort(rng.choice(len(p), size=min(n, len(p)), replace=False)) for p in sequence.points]
    return _keep(sequence, truth, rows)


def densify(sequence: PointSequence, truth: GroundTruth, n: int, *, seed: int = 0) -> Recording:
    """n points a frame, drawn from the fused points of all frames (all of these, where they are fewer)."""
    rng = np.random.default_rng(seed)
    clouds, labels = zip(*(_draw(n, *_fuse(sequence, truth, T), rng) for T in truth.poses), strict=True)
    return PointSequence.from_arrays(clouds), replace(truth, labels=labels)


def resample(sequence: PointSequence, truth: GroundTruth, n: int, *, seed: int = 0) -> Recording:
    """n points a frame: a subset where every frame has them, else fused."""
    enough = all(len(p) >= n for p in sequence.points)
    return (subsample if enough else densify)(sequence, truth, n, seed=seed)


def rescale(sequence: PointSequence, truth: GroundTruth, factors: Sequence[float]) -> Recording:
    """Every frame at its own scale, as states that were reconstructed one by one; the truth keeps the true size."""
    clouds = [k * p for k, p in zip(itertools.cycle(factors), sequence.points, strict=False)]
    return _recording(clouds, sequence, truth)


def drop_random_half(sequence: PointSequence, truth: GroundTruth, frame: int, *, seed: int = 0) -> Recording:
    """Half of one frame's points are gone, at random."""
    n = len(sequence.points[frame])
    kept = np.sort(np.random.default_rng(seed).choice(n, size=n - n // 2, replace=False))
    return _keep_in_frame(sequence, truth, frame, kept)


def drop_one_sided_half(sequence: PointSequence, truth: GroundTruth, frame: int, *, seed: int = 0) -> Recording:
    """The half of one frame's points that lies furthest in a random direction is gone."""
    depth = sequence.points[frame] @ random_directions(1, np.random.default_rng(seed))[0]
    return _keep_in_frame(sequence, truth, frame, np.sort(np.argsort(depth)[: len(depth) - len(depth) // 2]))


def one_sided(
    sequence: PointSequence, truth: GroundTruth, *, direction: Array | None = None, seed: int = 0
) -> Recording:
    """Every frame as one fixed camera sees it, from `direction` (3,) (random by default): about a third of the points.

    What hides what is judged on the fused points of all frames, as a sparse cloud is transparent; noise comes after.
    """
    camera = random_directions(1, np.random.default_rng(seed))[0] if direction is None else direction
    first = np.cumsum([0, *(len(p) for p in sequence.points)])
    rows = []
    for f, T in enumerate(truth.poses):
        visible = visible_points(_fuse(sequence, truth, T)[0], camera)
        rows.append(visible[(visible >= first[f]) & (visible < first[f + 1])] - first[f])
    return _keep(sequence, truth, rows)


def moving_root(
    sequence: PointSequence, truth: GroundTruth, *, step_deg: float = 5.0, share: float = 0.01, seed: int = 0
) -> Recording:
    """The whole object wanders: it turns by step_deg and shifts by `share` of its diagonal a frame; frame 0 stays."""
    low, high = sequence.points[0].min(axis=0), sequence.points[0].max(axis=0)
    step = share * float(np.linalg.norm(high - low))
    walk = root_walk(len(sequence), (low + high) / 2, np.random.default_rng(seed), step=step, step_deg=step_deg)
    clouds = [transform(T, p) for T, p in zip(walk, sequence.points, strict=True)]
    return _recording(clouds, sequence, replace(truth, poses=walk[:, None] @ truth.poses))


def other_world(sequence: PointSequence, truth: GroundTruth, *, seed: int = 0) -> Recording:
    """The same recording told in another world frame: turned at random, and shifted by the object's diagonal."""
    rng = np.random.default_rng(seed)
    turn, shift = random_directions(2, rng)
    W = exp_se3(np.concatenate([rng.uniform(0.5, np.pi) * turn, np.zeros(3)]))
    W[:3, 3] = np.linalg.norm(np.ptp(sequence.points[0], axis=0)) * shift
    carried = _carried(truth, np.broadcast_to(W, truth.poses[0].shape))
    moved = replace(carried, poses=W @ truth.poses @ inverse(W), novel=W @ truth.novel @ inverse(W))
    return _recording([transform(W, p) for p in sequence.points], sequence, moved)


def select_frames(sequence: PointSequence, truth: GroundTruth, frames: Sequence[int]) -> Recording:
    """The given frames in the given order; the first of them becomes the new frame 0 of the ground truth."""
    rows = list(frames)
    labels = point_labels(sequence, truth)
    base = truth.poses[rows[0]]
    selected = replace(
        _carried(truth, base),
        labels=tuple(labels[f] for f in rows),
        poses=truth.poses[rows] @ inverse(base),
        novel=truth.novel @ inverse(base),
        joint_state=None if truth.joint_state is None else truth.joint_state[rows],
    )
    told = (sequence.points, sequence.origins, sequence.sensor)
    return PointSequence.from_arrays(*([each[f] for f in rows] if each else () for each in told)), selected


def every_nth_frame(sequence: PointSequence, truth: GroundTruth, n: int) -> Recording:
    """Frames 0, n, 2n, ...: motion n times as fast."""
    return select_frames(sequence, truth, range(0, len(sequence), n))


def interpolate(sequence: PointSequence, truth: GroundTruth, frames: int, *, seed: int = 0) -> Recording:
    """The same motion in another number of frames, as many points a frame as before (on average); points are fused.

    Each joint moves along the screw that leads from one old frame to the next, so the tree stays exact.
    """
    rng = np.random.default_rng(seed)
    times = np.linspace(0, len(sequence) - 1, frames)
    poses = interpolated_poses(truth.poses, truth.parent, times)
    n = round(sum(len(p) for p in sequence.points) / len(sequence))
    clouds, labels = zip(*(_draw(n, *_fuse(sequence, truth, T), rng) for T in poses), strict=True)
    state = None if truth.joint_state is None else _linear(truth.joint_state, times)
    return PointSequence.from_arrays(clouds), replace(truth, labels=labels, poses=poses, joint_state=state)


def stepped_pair(
    sequence: PointSequence, truth: GroundTruth, frame: int, n: int, step_deg: float, *, seed: int = 0
) -> tuple[Array, Array, Array]:
    """One more step from a frame: two clouds (n, 3) that share no point, and where the first one's points go, (n, 3).

    Every hinge turns by about step_deg either way, every slide by the same share of the object's radius; all frames'
    points are fused.
    """
    rng = np.random.default_rng(seed)
    T = truth.poses[frame]
    radius = rms_radius(sequence.points[frame])
    stepped = _step(truth.poses, truth.parent, frame, np.deg2rad(step_deg), radius, rng)
    cloud, labels = _fuse(sequence, truth, T)
    rows = rng.permutation(len(cloud))[: 2 * n]
    first, second = rows[: len(rows) // 2], rows[len(rows) // 2 :]
    motion = (stepped @ inverse(T))[labels]
    moved = transform(motion, cloud)
    return cloud[first], moved[second], moved[first]


def _step(poses: Array, parent: IntArray, frame: int, step: float, radius: float, rng: np.random.Generator) -> Array:
    """(P, 4, 4) part motions one step on from a frame; joints are known by the motion that they show."""
    children = np.flatnonzero(parent >= 0)
    relative = inverse(poses[:, parent[children]]) @ poses[:, children]
    change = log_se3(inverse(relative[frame]) @ relative)  # (F, P - 1, 6)
    turn, slide = np.linalg.norm(change[..., :3], axis=-1), np.linalg.norm(change[..., 3:], axis=-1)
    turning = turn.max(axis=0) > 1e-3
    size = np.where(turning, turn, slide / radius)
    best = size.argmax(axis=0), np.arange(len(children))
    amount = step * rng.choice([-1, 1], len(children)) * rng.uniform(0.8, 1.2, len(children))
    out = poses[frame].copy()
    for p, twist in zip(children, change[best] * (amount / np.maximum(size[best], 1e-9))[:, None], strict=True):
        own = inverse(poses[frame, parent[p]]) @ poses[frame, p]
        out[p] = out[parent[p]] @ own @ exp_se3(twist)
    return out


def interpolated_poses(poses: Array, parent: IntArray, times: Array) -> Array:
    """Part motions (F, P, 4, 4) at real-valued frame numbers `times` (G,): (G, P, 4, 4).

    What is interpolated, on the logarithm, is each part's motion relative to its parent.
    """
    before = np.floor(times).astype(int).clip(0, max(len(poses) - 2, 0))
    after = np.minimum(before + 1, len(poses) - 1)
    relative = poses.copy()
    children = np.flatnonzero(parent >= 0)
    relative[:, children] = inverse(poses[:, parent[children]]) @ poses[:, children]
    change = log_se3(inverse(relative[before]) @ relative[after])
    out = relative[before] @ exp_se3((times - before)[:, None, None] * change)
    for p in children:  # parents come first
        out[:, p] = out[:, parent[p]] @ out[:, p]
    return out


def _recording(clouds: Sequence[Array], sequence: PointSequence, truth: GroundTruth) -> Recording:
    """New clouds whose points correspond one to one to those of `sequence`."""
    return PointSequence.from_arrays(clouds), replace(truth, labels=point_labels(sequence, truth))


def _keep(sequence: PointSequence, truth: GroundTruth, rows: Sequence[IntArray]) -> Recording:
    """The given rows of every frame."""
    labels = tuple(part[r] for part, r in zip(point_labels(sequence, truth), rows, strict=True))
    clouds = [p[r] for p, r in zip(sequence.points, rows, strict=True)]
    return PointSequence.from_arrays(clouds), replace(truth, labels=labels)


def _keep_in_frame(sequence: PointSequence, truth: GroundTruth, frame: int, kept: IntArray) -> Recording:
    rows = [kept if f == frame else np.arange(len(p)) for f, p in enumerate(sequence.points)]
    return _keep(sequence, truth, rows)


def _fuse(sequence: PointSequence, truth: GroundTruth, T: Array) -> tuple[Array, IntArray]:
    """All points in order, carried by the true part motions to poses T (P, 4, 4): points (M, 3), labels (M,)."""
    labels = np.concatenate(point_labels(sequence, truth))
    frame = np.repeat(np.arange(len(sequence)), [len(p) for p in sequence.points])
    motion = T @ inverse(truth.poses)  # (F, P, 4, 4)
    return transform(motion[frame, labels], np.concatenate(sequence.points)), labels


def _draw(n: int, cloud: Array, labels: IntArray, rng: np.random.Generator) -> tuple[Array, IntArray]:
    """At most n random rows of a cloud (M, 3) and its labels (M,)."""
    kept = np.sort(rng.choice(len(cloud), size=min(n, len(cloud)), replace=False))
    return cloud[kept], labels[kept]


def _carried(truth: GroundTruth, base: Array) -> GroundTruth:
    """Joint axes and points carried by their parents from frame 0 to the frame of poses `base` (P, 4, 4)."""
    if truth.joint_axis is None or truth.joint_point is None:
        return truth
    T = base[truth.parent.clip(min=0)]
    point = np.where((truth.parent >= 0)[:, None], transform(T, truth.joint_point), truth.joint_point)
    return replace(truth, joint_axis=rotate(T, truth.joint_axis), joint_point=point)


def _linear(values: Array, times: Array) -> Array:
    """Rows of `values` (F, P) at real-valued frame numbers: (G, P)."""
    frames = np.arange(len(values))
    return np.stack([np.interp(times, frames, column) for column in values.T], axis=1)
