"""The part field: which part each canonical point belongs to (paper, sec. 3.1, "semantic field").

Parts are drawn by the Gumbel-softmax trick with a straight-through gradient (Jang et al. 2017, Bengio et al. 2013).
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from rearticulate.config import NeuralConfig

START_RATE = 1e-2  # Adam, while the field is fitted to given labels
FIRST_LOGIT = 0.1  # standard deviation of the logits of points that choose for themselves, at the beginning


class PartField(nn.Module):
    """Logits of the parts at points: an MLP 3-hidden-parts."""

    def __init__(self, parts: int, hidden: int, generator: torch.Generator):
        super().__init__()
        self.inner = _linear(3, hidden, generator)
        self.outer = _linear(hidden, parts, generator)

    def forward(self, points: Tensor) -> Tensor:
        """(N, 3) -> (N, P)."""
        return self.outer(torch.relu(self.inner(points)))


class PointChoices(nn.Module):
    """Logits of the parts at the canonical points, one by one: the ablation without a field."""

    def __init__(self, parts: int, n: int, generator: torch.Generator):
        super().__init__()
        self.logits = nn.Parameter(FIRST_LOGIT * torch.randn((n, parts), generator=generator, device=generator.device))

    def forward(self, points: Tensor) -> Tensor:
        """(N, 3), the canonical points -> (N, P)."""
        return self.logits


def _linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """torch's usual layer, drawn from `generator`."""
    layer = nn.Linear(inputs, outputs, device="meta").to_empty(device=generator.device)
    for parameter in layer.parameters():
        nn.init.uniform_(parameter, -(inputs**-0.5), inputs**-0.5, generator=generator)
    return layer


def draw_parts(logits: Tensor, temperature: float, generator: torch.Generator) -> Tensor:
    """(N, P) one drawn part a point, one-hot; its gradient is that of the softmax of the same draw."""
    noise = -(-torch.rand(logits.shape, generator=generator, dtype=logits.dtype, device=logits.device).log()).log()
    soft = ((logits + noise) / temperature).softmax(dim=1)
    hard = torch.zeros_like(soft).scatter_(1, soft.argmax(dim=1, keepdim=True), 1.0)
    return hard + soft - soft.detach()


def cosine(first: float, last: float, done: float) -> float:
    """From first to last along half a cosine; done in [0, 1]."""
    return last + (first - last) * 0.5 * (1.0 + float(np.cos(np.pi * done)))


def fit_labels(field: nn.Module, points: Tensor, labels: Tensor, config: NeuralConfig) -> None:
    """Teach the field labels (N,) of the canonical points (N, 3)."""
    optimiser = torch.optim.Adam(field.parameters(), lr=START_RATE)
    for _ in range(config.start_iterations):
        optimiser.zero_grad()
        cross_entropy(field(points), labels).backward()
        optimiser.step()
