"""What training asks of features: the cross-entropy of their matching scores (appendix A.1)."""

from __future__ import annotations

import torch
from torch import Tensor


def scores(a: Tensor, b: Tensor) -> Tensor:
    """(..., n, m) matching scores of features a (..., n, d) and b (..., m, d) before the softmax (appendix A.1)."""
    return a @ b.transpose(-1, -2) / a.shape[-1] ** 0.5


def matching_loss(a: Tensor, b: Tensor, to_b: Tensor, rows: Tensor) -> Tensor:
    """Mean cross-entropy of the softmax over b (B, m, d) at some rows (B, k) of a (B, n, d), whose true rows are
    to_b (B, n), -1 where there is none; 0 if no row has one."""
    asked = torch.gather(a, 1, rows[..., None].expand(-1, -1, a.shape[-1]))
    truth = torch.gather(to_b, 1, rows)
    logits = scores(asked, b)
    total = torch.nn.functional.cross_entropy(logits.flatten(0, 1), truth.flatten(), ignore_index=-1, reduction="sum")
    return total / (truth >= 0).sum().clamp(min=1)
