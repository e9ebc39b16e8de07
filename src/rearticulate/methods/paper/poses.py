"""Rigid part poses without constraint: a rotation as six numbers (Zhou et al. 2019), and a translation."""

from __future__ import annotations

import torch
from torch import Tensor

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def rotations(six: Tensor) -> Tensor:
    """(..., 6) -> (..., 3, 3): the first two columns, orthonormalised in turn (Gram-Schmidt), and their product."""
    a = torch.nn.functional.normalize(six[..., :3], dim=-1)
    b = six[..., 3:] - (a * six[..., 3:]).sum(dim=-1, keepdim=True) * a
    b = torch.nn.functional.normalize(b, dim=-1)
    return torch.stack([a, b, torch.linalg.cross(a, b)], dim=-1)


def to_matrices(poses: Tensor) -> Tensor:
    """(..., 9) six numbers of a rotation and a translation -> (..., 3, 4)."""
    return torch.cat([rotations(poses[..., :6]), poses[..., 6:, None]], dim=-1)


def with_identity(T: Tensor, canonical: int) -> Tensor:
    """(F - 1, P, 3, 4) motions to all frames but the canonical one -> (F, P, 3, 4), the identity there."""
    still = torch.eye(3, 4, dtype=T.dtype, device=T.device).expand(1, T.shape[1], 3, 4)
    return torch.cat([T[:canonical], still, T[canonical:]])


def from_matrices(T: Tensor) -> Tensor:
    """(..., 4, 4) -> (..., 9)."""
    return torch.cat([T[..., :3, 0], T[..., :3, 1], T[..., :3, 3]], dim=-1)


def move(T: Tensor, weights: Tensor, points: Tensor) -> Tensor:
    """(F, N, 3) points (N, 3) by the blend (N, P) of the part poses T (F, P, 3, 4); one part with weight 1 is rigid.

    All frames and parts in one matrix product, forward as well as backward.
    """
    F, P = T.shape[:2]
    homogeneous = torch.cat([points, torch.ones_like(points[:, :1])], dim=1)
    spread = (weights[:, :, None] * homogeneous[:, None, :]).reshape(len(points), 4 * P)
    return (spread @ T.permute(1, 3, 0, 2).reshape(4 * P, 3 * F)).reshape(-1, F, 3).transpose(0, 1)
