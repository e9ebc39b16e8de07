"""Inverse kinematics: the pose of a model from a few points and where they should go (paper, supplement A.6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from rearticulate.errors import InputError
from rearticulate.geometry.kabsch import kabsch
from rearticulate.geometry.se3 import exp_se3, from_unit, hat, inverse, transform
from rearticulate.posing.single import single_valued
from rearticulate.records import Array, IntArray, KinematicModel
from rearticulate.retargeting.least_squares import BoolArray, PoseProblem, Starts, residuals, solve, start

SIGMAS = (np.inf, 0.03, 0.01)  # robust scales, coarse to fine, in sizes of the object (bounding box diagonal)
RANDOM_STARTS = 6
SURVIVORS = 5  # starts that are followed beyond the coarsest scale
MIN_SPAN = 0.2  # the range of a joint that hardly moved counts as this much, rad or sizes
SEAM = 4.0  # a point this close to another part, in point spacings, may belong to it
RELABEL_GAIN = 0.3  # energy that a new label must save, in outliers (an outlier costs sigma^2)
MAX_RELABELS = 4
MAX_ALTERNATIVES = 16


@dataclass(frozen=True)
class RetargetResult:
    """q (D,) rad or m (the root's entry is 0), T_world_root (4, 4), residual (K,) distances that remain, m.

    part: (K,) the part each source point was taken to belong to. converged; iterations: over all starts together.
    """

    q: Array
    T_world_root: Array
    residual: Array
    part: IntArray
    converged: bool
    iterations: int


def retarget(
    model: KinematicModel,
    source_points: Array,
    target_points: Array,
    *,
    part: IntArray | None = None,
    free_root: bool = True,
    seed: int = 0,
    q: Array | None = None,
    T_world_root: Array | None = None,
) -> RetargetResult:
    """Joint values and root pose that bring source points (K, 3) of the canonical frame to their targets (K, 3).

    part: (K,) parts of the source points; without it `model.part_of`, corrected where a point lies at a seam and the
    other part explains its target better. free_root: False keeps the root where it is. q (D,), T_world_root (4, 4):
    the present posture, that of the canonical frame when absent; joints that move no source point stay there. With q
    the answer is the one nearest to it, for dragging: no other is looked for.
    The loss is robust, so a few wrong pairs do no harm.
    """
    if "spherical" in model.joint_type:
        hinges = single_valued(model)
        own = None if part is None else hinges.number[_parts(model, part, len(np.asarray(source_points)))]
        present = None if q is None else hinges.hinges(np.asarray(q, dtype=np.float64)[None])[0]
        found = retarget(
            hinges.model,
            source_points,
            target_points,
            part=own,
            free_root=free_root,
            seed=seed,
            q=present,
            T_world_root=T_world_root,
        )
        known = np.searchsorted(hinges.number, found.part)
        return replace(found, q=hinges.back(found.q), part=known)
    source, target = _points("source", source_points), _points("target", target_points)
    if source.shape != target.shape:
        raise InputError(f"{len(source)} source points but {len(target)} target points: they must come in pairs")
    labels = model.part_of(source) if part is None else _parts(model, part, len(source))
    scale, root = _Scale.of(model), np.eye(4) if T_world_root is None else np.asarray(T_world_root, dtype=np.float64)
    here = transform(inverse(root), target)  # the root's motion is sought from where it is
    problem = _problem(model, scale, source, here, free_root, None if q is None else _values(model, q))
    guesses = _first_guesses(problem, labels, np.random.default_rng(seed)) if q is None else _present(problem, labels)
    best = _descend(problem, guesses)
    if part is None:
        best = _relabel(problem, best, _alternatives(model, source, labels))
    found = _result(model, scale, problem, best)
    return replace(found, T_world_root=root @ found.T_world_root)


def _points(name: str, points: Array) -> Array:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise InputError(f"{name} points have shape {array.shape}: give at least one row of x, y, z, shape (K, 3)")
    if not np.isfinite(array).all():
        row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise InputError(f"{name} point {row} is {array[row].tolist()}: all coordinates must be finite numbers")
    return array


def _parts(model: KinematicModel, part: IntArray, K: int) -> IntArray:
    labels = np.asarray(part)
    if labels.shape != (K,) or not np.issubdtype(labels.dtype, np.integer):
        raise InputError(f"part has shape {labels.shape} and type {labels.dtype}: give one part number a source point")
    unknown = labels[(labels < 0) | (labels >= model.n_parts)]
    if len(unknown):
        raise InputError(f"unknown part {unknown[0]}: the model has parts 0 to {model.n_parts - 1}")
    return labels.astype(np.int64)


def _values(model: KinematicModel, q: Array) -> Array:
    values = np.asarray(q, dtype=np.float64)
    if values.shape != (model.n_parts,) or not np.isfinite(values).all():
        raise InputError(f"q has shape {values.shape}: give one finite joint value a part, shape ({model.n_parts},)")
    return values


@dataclass(frozen=True)
class _Scale:
    """The solver's private units: origin at the middle of the canonical cloud, its bounding box diagonal as unit."""

    centre: Array
    size: float

    @staticmethod
    def of(model: KinematicModel) -> _Scale:
        low, high = model.points.min(axis=0), model.points.max(axis=0)
        return _Scale((low + high) / 2, float(np.linalg.norm(high - low)) or 1.0)

    def shrink(self, points: Array) -> Array:
        return (points - self.centre) / self.size


def _problem(
    model: KinematicModel, scale: _Scale, source: Array, target: Array, free_root: bool, q: Array | None
) -> PoseProblem:
    twists = model.twists.copy()
    for j in np.flatnonzero(twists[:, :3].any(axis=1)):
        twists[j, 3:] = np.cross(scale.shrink(model.origin[j]), model.axis[j])
    limits = model.limits / _units(model, scale)[:, None]
    path = np.zeros((model.n_parts, model.n_parts), dtype=bool)
    for j in range(1, model.n_parts):
        path[j] = path[model.parent[j]]
        path[j, j] = twists[j].any()
    return PoseProblem(
        parent=model.parent,
        twists=twists,
        limits=limits,
        rest=limits.mean(axis=1) if q is None else q / _units(model, scale),
        held=np.zeros(model.n_parts) if q is None else q / _units(model, scale),
        span=np.maximum(limits[:, 1] - limits[:, 0], MIN_SPAN),
        path=path,
        source=scale.shrink(source),
        target=scale.shrink(target),
        free_root=free_root,
    )


def _units(model: KinematicModel, scale: _Scale) -> Array:
    """(P,) what one private unit of each joint value is in the model: rad, or m for a slide."""
    return np.where([kind == "prismatic" for kind in model.joint_type], scale.size, 1.0)


def _first_guesses(problem: PoseProblem, part: IntArray, rng: np.random.Generator) -> Starts:
    """Zero, the middle of the observed ranges and random values; then all of them led along the chains of the tree."""
    low, high = problem.limits[:, 0] - problem.span, problem.limits[:, 1] + problem.span
    q = np.concatenate([[np.zeros_like(low), problem.rest], rng.uniform(low, high, (RANDOM_STARTS, len(low)))])
    root = np.tile(np.eye(4), (len(q), 1, 1))
    if problem.free_root:
        own = part == 0
        known = own if own.sum() >= 3 else np.ones_like(own)  # the root's own points tell its pose, if there are enough
        root[1::2] = kabsch(problem.source[known], problem.target[known])
    return _with_led(problem, q, root, np.tile(part, (len(q), 1)))


def _present(problem: PoseProblem, part: IntArray) -> Starts:
    """The present posture."""
    return _with_led(problem, problem.held[None], np.eye(4)[None], part[None])


def _with_led(problem: PoseProblem, q: Array, root: Array, part: IntArray) -> Starts:
    """Every guess twice: as it is, and led along the chains."""
    led = follow_chains(problem, q, root, part)
    return start(problem, np.concatenate([q, led]), np.tile(root, (2, 1, 1)), np.tile(part, (2, 1)))


def follow_chains(problem: PoseProblem, q: Array, root: Array, part: IntArray) -> Array:
    """From the root outwards, set every joint to the value that is best for its own part's points.

    q (B, P), root (B, 4, 4), part (B, K). Returns (B, P); parts without source points keep their value.
    """
    q, T = q.copy(), np.tile(root[:, None], (1, len(problem.parent), 1, 1))
    for j in range(1, len(problem.parent)):
        T_parent, own = T[:, problem.parent[j]], part == j
        if own.any() and problem.path[j, j]:
            seen = transform(inverse(T_parent)[:, None], problem.target)
            value = best_joint_value(problem.twists[j], problem.source, seen, own)
            q[:, j] = np.where(own.any(axis=1), value, q[:, j])
        T[:, j] = T_parent @ exp_se3(q[:, j, None] * problem.twists[j])
    return q


def best_joint_value(twist: Array, source: Array, target: Array, own: BoolArray) -> Array:
    """(B,) joint value that brings the points source (K, 3) where own (B, K) nearest to target (B, K, 3).

    In closed form: a turn is a Procrustes problem in the plane across the axis, a slide a mean along it.
    """
    w, v = twist[:3], twist[3:]
    if not w.any():
        return (((target - source) @ v) * own).sum(axis=1) / np.maximum(own.sum(axis=1), 1)
    origin = np.cross(w, v)
    a, b = source - origin, target - origin
    sine, cosine = (b * (a @ hat(w).T)).sum(axis=-1), (b * (a - np.outer(a @ w, w))).sum(axis=-1)
    return np.arctan2((sine * own).sum(axis=1), (cosine * own).sum(axis=1))


def _descend(problem: PoseProblem, starts: Starts) -> Starts:
    """The best start after all scales, coarse to fine, as a batch of one."""
    for sigma in SIGMAS[:-1]:
        starts = solve(problem, starts, sigma, 15)
        starts = starts.best(SURVIVORS)
    return _finish(problem, starts)


def _finish(problem: PoseProblem, starts: Starts) -> Starts:
    return solve(problem, starts, SIGMAS[-1], 40).best(1)


def _alternatives(model: KinematicModel, source: Array, part: IntArray) -> list[tuple[int, int]]:
    """Pairs (source point, other part) where the other part comes within a few point spacings of the source point."""
    tree = KDTree(model.points)
    sample = model.points[:: max(1, len(model.points) // 256)]
    spacing = float(np.median(tree.query(sample, k=min(2, len(model.points)))[0].reshape(len(sample), -1)[:, -1]))
    near = tree.query_ball_point(source, SEAM * spacing)
    pairs = [(k, int(p)) for k, rows in enumerate(near) for p in np.unique(model.labels[rows]) if p != part[k]]
    return pairs[:MAX_ALTERNATIVES]


def _relabel(problem: PoseProblem, best: Starts, alternatives: list[tuple[int, int]]) -> Starts:
    """Give points at seams to the other part, one after the other, as long as that explains an outlier.

    A wrong label may well leave its own point in place and drive away others: every alternative is tried.
    """
    sigma = SIGMAS[-1]
    for _ in range(MAX_RELABELS):
        pairs = [(k, p) for k, p in alternatives if best.part[0, k] != p]
        if not pairs or (residuals(problem, best) ** 2).sum(axis=-1).max() < sigma**2:
            break
        trial = _finish(problem, solve(problem, _relabelled(problem, best, pairs), SIGMAS[-2], 10).best(SURVIVORS))
        if trial.energy[0] > best.energy[0] - RELABEL_GAIN * sigma**2:
            break
        best = trial
    return best


def _relabelled(problem: PoseProblem, best: Starts, pairs: list[tuple[int, int]]) -> Starts:
    """The present solution once a pair (source point, new part), as it is and led along the chains."""
    part = np.tile(best.part, (len(pairs), 1))
    for row, (k, p) in enumerate(pairs):
        part[row, k] = p
    return _with_led(problem, np.tile(best.q, (len(pairs), 1)), np.tile(best.root, (len(pairs), 1, 1)), part)


def _result(model: KinematicModel, scale: _Scale, problem: PoseProblem, best: Starts) -> RetargetResult:
    turns = np.array([kind == "revolute" for kind in model.joint_type])
    q = best.q[0] - 2 * np.pi * turns * np.round((best.q[0] - problem.rest) / (2 * np.pi))
    return RetargetResult(
        q=q * _units(model, scale),
        T_world_root=from_unit(best.root[0], scale.size, scale.centre),
        residual=scale.size * np.linalg.norm(residuals(problem, best)[0], axis=-1),
        part=best.part[0],
        converged=bool(best.converged[0]),
        iterations=best.iterations,
    )
