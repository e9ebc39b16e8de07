"""Pairs of clouds of one articulated object in two postures, with the correspondences that are true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.bounds import NotNegative, Settings, Share
from rearticulate.geometry.nearest import nearest, rms_radius, search_tree
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.synth.articulated import ArticulatedObject
from rearticulate.synth.surfaces import sample_parts
from rearticulate.synth.trajectories import finite_limits, random_directions, start_posture, sweep
from rearticulate.synth.visibility import visible_points

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

POOL = 32_000  # surface points an object is recorded from
OCCLUDED = 3.0  # a true neighbour farther than this, in point spacings, is none


@dataclass(frozen=True)
class PairConfig(Settings):
    """How pairs vary. Angles in degrees; lengths in root mean square radii of the object."""

    step_deg: tuple[NotNegative, NotNegative] = (2.0, 30.0)
    still: Share = 0.2  # share of the joints that stand still
    upright: Share = 0.6  # share of the pairs that are turned about the vertical alone, and tilted a little
    tilt_deg: NotNegative = 10.0
    root: Share = 0.5  # share of the pairs whose root moves, too
    root_deg: NotNegative = 15.0
    root_shift: NotNegative = 0.1
    noise: tuple[NotNegative, NotNegative] = (0.0, 0.015)
    noisy: Share = 0.5
    one_sided: Share = 0.15
    hole: Share = 0.3  # share of the pairs from whose second cloud a ball is cut out
    hole_radius: tuple[NotNegative, NotNegative] = (0.1, 0.4)


@dataclass(frozen=True)
class Subject:
    """An articulated object with a stock of surface points at rest, (M, 3), and their parts, (M,)."""

    thing: ArticulatedObject
    points: Array
    labels: IntArray


@dataclass(frozen=True)
class Pair:
    """Two clouds a, b (n, 3). to_b, to_a (n,): row of the true nearest neighbour in the other cloud, -1 for none.

    scale: root mean square radius of the object, by which both are to be divided.
    """

    a: Array
    b: Array
    to_b: IntArray
    to_a: IntArray
    scale: float


def make_subject(thing: ArticulatedObject, rng: np.random.Generator) -> Subject:
    """Draw the stock of surface points, uniformly over the area."""
    return Subject(thing, *sample_parts(thing.surfaces, POOL, rng))


def make_pair(subject: Subject, n: int, config: PairConfig, rng: np.random.Generator) -> Pair:
    """Record a subject in two postures, n points each and no point in both."""
    step = np.deg2rad(rng.uniform(*config.step_deg))
    T_a, T_b = _poses(subject.thing, step, config, rng)
    turn = _orientation(config, rng)
    T_a, T_b = turn @ T_a, turn @ T_b
    stock = rng.permutation(len(subject.points))
    halves = stock[: len(stock) // 2], stock[len(stock) // 2 :]
    camera = random_directions(1, rng)[0] if rng.random() < config.one_sided else None
    if camera is None:
        whole = halves[1] if rng.random() > config.hole else _outside_hole(subject, halves[1], n, config, rng)
        rows_a, rows_b = halves[0][:n], whole[:n]
    else:
        rows_a, rows_b = (_seen(subject, h, T, n, camera) for h, T in zip(halves, (T_a, T_b), strict=True))
    clean_a, clean_b = _placed(subject, rows_a, T_a), _placed(subject, rows_b, T_b)
    scale = rms_radius(clean_a)
    sigma = scale * rng.uniform(*config.noise) if rng.random() < config.noisy else 0.0
    return Pair(
        a=clean_a + sigma * rng.normal(size=clean_a.shape),
        b=clean_b + sigma * rng.normal(size=clean_b.shape),
        to_b=true_matches(_placed(subject, rows_a, T_b), clean_b),
        to_a=true_matches(_placed(subject, rows_b, T_a), clean_a),
        scale=scale,
    )


def true_matches(moved: Array, cloud: Array) -> IntArray:
    """(n,) nearest row of `cloud` (m, 3) to each point (n, 3) that was moved there by the truth; -1 where it is far."""
    tree = search_tree(cloud)
    spacing = float(np.median(nearest(tree, cloud, k=2)[0][:, 1]))
    distance, row = nearest(tree, moved)
    return np.where(distance < OCCLUDED * spacing, row, -1)


def _poses(thing: ArticulatedObject, step: float, config: PairConfig, rng: np.random.Generator) -> tuple[Array, Array]:
    """Part poses (P, 4, 4) of two postures a step apart: radians for hinges, as a share of half a turn for slides."""
    low, high = finite_limits(thing.limits).T
    steps = np.where(thing.revolute, step, (high - low) * step / np.pi)
    steps[rng.random(thing.n_parts) < config.still] = 0.0
    q = thing.follow(sweep(start_posture(thing.limits, "random", rng), thing.limits, steps, 2, rng))
    T = thing.forward(q)
    if rng.random() < config.root:
        middle = transform(T[0, 0], thing.surfaces[0].reshape(-1, 3)).mean(axis=0)
        radius = float(np.ptp(thing.surfaces[0].reshape(-1, 3), axis=0).max())
        axis, direction = random_directions(2, rng)
        spin = exp_se3(np.concatenate([np.deg2rad(rng.uniform(0, config.root_deg)) * axis, np.zeros(3)]))
        about = np.eye(4)
        about[:3, 3] = middle
        shift = np.eye(4)
        shift[:3, 3] = rng.uniform(0, config.root_shift) * radius * direction
        T[1] = shift @ about @ spin @ inverse(about) @ T[1]
    return T[0], T[1]


def _orientation(config: PairConfig, rng: np.random.Generator) -> Array:
    """(4, 4) how the object stands: upright but turned and tilted, or in any way."""
    turn = np.array([0, 0, rng.uniform(-np.pi, np.pi)])
    axis = random_directions(1, rng)[0]
    upright = rng.random() < config.upright
    tilt = axis * (np.deg2rad(rng.uniform(0, config.tilt_deg)) if upright else rng.uniform(0, np.pi))
    zero = np.zeros(3)
    return exp_se3(np.concatenate([tilt, zero])) @ exp_se3(np.concatenate([turn, zero]))


def _placed(subject: Subject, rows: IntArray, T: Array) -> Array:
    return transform(T[subject.labels[rows]], subject.points[rows])


def _seen(subject: Subject, stock: IntArray, T: Array, n: int, camera: Array) -> IntArray:
    """n rows of the stock that a camera sees; of all of it where it sees fewer."""
    seen = stock[visible_points(_placed(subject, stock, T), camera)]
    return (seen if len(seen) >= n else stock)[:n]


def _outside_hole(subject: Subject, stock: IntArray, n: int, config: PairConfig, rng: np.random.Generator) -> IntArray:
    """The rows of the stock outside of a random ball of the rest pose; all of them if fewer than n would be left."""
    points = subject.points[stock]
    radius = rng.uniform(*config.hole_radius) * rms_radius(points)
    outside = stock[np.linalg.norm(points - points[rng.integers(len(points))], axis=1) > radius]
    return outside if len(outside) >= n else stock
