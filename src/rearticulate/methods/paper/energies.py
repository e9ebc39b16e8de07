"""The three terms of the reconstruction energy (paper, sec. 3.2) for given correspondences, differentiable by autograd.

x (F, N, 3): the canonical points moved to every frame. Sums over points and frames, of squared lengths.
"""

from __future__ import annotations

from torch import Tensor


def chamfer_energy(x: Tensor, target: Tensor, near_target: Tensor, near_model: Tensor) -> Tensor:
    """E_CD: every moved point to its nearest observed one, and every observed point to its nearest moved one.

    target (M, 3): the points of all frames. near_target (F * N,): row in target. near_model (M,): row in F * N.
    """
    flat = x.reshape(-1, 3)
    forward = flat - target[near_target]
    backward = flat.index_select(0, near_model) - target
    return forward.square().sum() + backward.square().sum()


def assignment_energy(x: Tensor, target: Tensor, moved: Tensor, assigned: Tensor) -> Tensor:
    """E_EMD: rows moved (K,) of the F * N moved points, each to its row assigned (K,) of target (M, 3)."""
    return (x.reshape(-1, 3).index_select(0, moved) - target[assigned]).square().sum()


def flow_energy(x: Tensor, observed: Tensor, weight: Tensor) -> Tensor:
    """E_flow: the step of every point to the next frame against observed (F - 1, N, 3), by weight (F - 1, N)."""
    return ((x[1:] - x[:-1] - observed).square().sum(dim=-1) * weight).sum()
