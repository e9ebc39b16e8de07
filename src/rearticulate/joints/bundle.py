"""Kinematic adjustment of the tree of screws, all joint values and root poses at once: against free poses with their
information (cheap, no search for neighbours), then against all points (bundle adjustment)."""

from __future__ import annotations

from functools import partial

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.geometry.robust import geman_mcclure
from rearticulate.geometry.se3 import inverse, log_se3
from rearticulate.joints.articulated import Articulated, gauss_newton_step
from rearticulate.observe.body import HELD, INNER, find_pairs
from rearticulate.observe.frames import Frames
from rearticulate.observe.fused import points_behind
from rearticulate.observe.register import CONVERGED
from rearticulate.parallel import each
from rearticulate.parts.bodies import Bodies, bodies_equations, make_bodies
from rearticulate.progress import Told, untold

SIGMA_WIDE, SIGMA = 1.5, 0.56  # robust scales of a point, first and usual, in spacings
FINE, FINE_NOISE, FINE_MAX = 0.2, 2.5, 0.8  # the last scale: at least, in units of the noise, at most
POSE_STEPS = 15
POSE_SIGMA = 1.0  # robust scale of a part's misfit to its free pose, in spacings


def adjust_to_poses(
    model: Articulated,
    canonical: int,
    part: Int[Array, " K"],
    T: Float[Array, "F K 4 4"],
    H: Float[Array, "F K 6 6"],
    sigma: float = POSE_SIGMA,
) -> tuple[Articulated, Float[Array, "F K"]]:
    """The tree that agrees best with K observed poses T of parts part under information H.

    Joints fitted pair by pair disagree along a chain; here they are made consistent. An observation that no tree
    reaches (a lost part) loses its weight. Returns the best iterate and its misfit in spacings squared.
    """
    points = points_behind(H) + 1e-9
    of_part = np.eye(model.n_parts)[part]
    best, lowest, misfit = model, np.inf, np.zeros(points.shape)
    for i in range(POSE_STEPS + 1):
        e = log_se3(model.forward()[:, part] @ inverse(T))
        squared = np.einsum("fki,fkij,fkj->fk", e, H, e) / points
        cost = float((points * squared / (squared + sigma**2)).sum())
        if i > 0 and cost > (1 - 1e-3) * lowest:
            break
        best, lowest, misfit = model, cost, squared
        w = geman_mcclure(squared, sigma)[..., None]
        H_part = np.einsum("kp,fkij->fpij", of_part, w[..., None] * H)
        g_part = np.einsum("kp,fki->fpi", of_part, w * (H @ e[..., None])[..., 0])
        model = gauss_newton_step(model, canonical, H_part, g_part)
    return best, misfit


def last_sigma(noise: float) -> float:
    """The robust scale when labels are settled and what does not fit is wrong. noise: of the surface, in spacings."""
    return float(np.clip(FINE_NOISE * noise, FINE, FINE_MAX))


def bundle_adjust(
    frames: Frames,
    canonical: int,
    model: Articulated,
    labels: Int[Array, " M"],
    sigmas: tuple[float, ...],
    before: Bodies = (),
    told: Told = untold,
) -> tuple[Articulated, Bodies]:
    """Gauss-Newton on all points against the points of their own part, with new normals once a scale. sigmas: robust
    scales, in spacings. before: bodies of the parts, where they are known. Returns the tree and its bodies."""
    bodies = make_bodies(frames, model.forward(), labels, before)
    for i, sigma in enumerate(sigmas):
        moved = bodies
        for k in range(INNER):
            told((i + k / INNER) / len(sigmas))
            if k % HELD == 0:
                pairs = each(partial(find_pairs, sigma=sigma), moved)
            H, g = bodies_equations(moved, sigma, pairs)
            last, model = model, gauss_newton_step(model, canonical, H, g)
            if np.abs(model.q - last.q).max() < CONVERGED and np.abs(model.twist - last.twist).max() < CONVERGED:
                break
            T = model.forward()
            moved = tuple(body.moved(T[:, p]) for p, body in enumerate(moved))
        bodies = make_bodies(frames, model.forward(), labels, bodies)
    return model, bodies
