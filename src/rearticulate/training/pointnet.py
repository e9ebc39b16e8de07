"""PointNet++ with multi-scale grouping (Qi et al., NeurIPS 2017): 64 features a point (paper, appendix A.1)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from rearticulate.network.pyramid import RADII, Pyramid

FEATURES = 64
ABSTRACTION = ((32, 32, 64), (64, 64, 128), (128, 128, 256))  # widths of the layers of every level, for each scale
GLOBAL = 256
PROPAGATION = (128, 128, 256)  # width of the features at every level on the way back


class Batch:
    """Pyramids of clouds of the same size as tensors: rows of all clouds under each other, one index space a level."""

    def __init__(self, pyramids: Sequence[Pyramid], device: torch.device | str = "cpu") -> None:
        def tensor(x: np.ndarray) -> Tensor:
            return torch.from_numpy(x).to(device)

        def rows(which: str, level: int, sources: int) -> Tensor:
            return tensor(np.concatenate([getattr(p, which)[level] + i * sources for i, p in enumerate(pyramids)]))

        levels = range(len(RADII))
        self.clouds = len(pyramids)
        self.sizes = [len(pyramids[0].points)] + [len(n) for n in pyramids[0].near]
        points = np.stack([p.points for p in pyramids])
        self.points = [tensor(points[:, :n].reshape(-1, 3)) for n in self.sizes]
        self.near = [rows("near", i, self.sizes[i]) for i in levels]
        self.wide = [rows("wide", i, self.sizes[i + 1]) for i in levels]
        self.anchors = [rows("anchors", i, self.sizes[i + 1]) for i in levels]
        self.weights = [tensor(np.concatenate([p.weights[i] for p in pyramids])) for i in levels]

    def thin(self, features: Tensor, level: int) -> Tensor:
        """The rows of the features (B N_l, C) of a level whose points are in the next one too."""
        stacked = features.reshape(self.clouds, self.sizes[level], -1)
        return stacked[:, : self.sizes[level + 1]].reshape(-1, features.shape[1])


def layers(widths: Sequence[int]) -> nn.Sequential:
    """Linear layers, each normalised and rectified."""
    steps = [nn.Sequential(nn.Linear(a, b, bias=False), nn.LayerNorm(b), nn.ReLU()) for a, b in pairwise(widths)]
    return nn.Sequential(*steps)


class Scale(nn.Module):
    """One grouping scale: features of the neighbours and where they lie -> the largest of each channel.

    The first layer is linear, so it runs once a point before the points are grouped.
    """

    def __init__(self, channels: int, widths: Sequence[int], radius: float) -> None:
        super().__init__()
        self.radius = radius
        self.offset = nn.Linear(3, widths[0], bias=False)
        self.feature = nn.Linear(channels, widths[0], bias=False)
        self.first = nn.Sequential(nn.LayerNorm(widths[0]), nn.ReLU())
        self.rest = layers(widths)

    def forward(self, points: Tensor, features: Tensor, centres: Tensor, neighbours: Tensor) -> Tensor:
        """points (M, 3), features (M, C), centres (m, 3), neighbours (m, K) rows of points -> (m, widths[-1])."""
        source = self.feature(features) + self.offset(points / self.radius)
        grouped = nn.functional.embedding(neighbours, source) - self.offset(centres / self.radius)[:, None]
        return self.rest(self.first(grouped)).max(dim=1).values


class Abstraction(nn.Module):
    """A level of the pyramid from the one before: a near and a wide scale side by side."""

    def __init__(self, channels: int, widths: Sequence[int], radius: float) -> None:
        super().__init__()
        self.near = Scale(channels, widths, radius)
        self.wide = Scale(channels, widths, 2 * radius)

    def forward(self, batch: Batch, level: int, features: Tensor) -> Tensor:
        here, centres = batch.points[level], batch.points[level + 1]
        near = self.near(here, features, centres, batch.near[level])
        wide = self.wide(centres, batch.thin(features, level), centres, batch.wide[level])
        return torch.cat([near, wide], dim=1)


class CorrespondenceNet(nn.Module):
    """Clouds -> features (B, N, 64), in the order of their pyramids."""

    def __init__(self) -> None:
        super().__init__()
        channels = [3] + [2 * w[-1] for w in ABSTRACTION]
        self.down = nn.ModuleList(
            Abstraction(c, w, r) for c, w, r in zip(channels[:-1], ABSTRACTION, RADII, strict=True)
        )
        self.whole = layers([channels[-1], GLOBAL])
        above = [*PROPAGATION[1:], channels[-1] + GLOBAL]
        self.up = nn.ModuleList(
            layers([a + c, p, p]) for a, c, p in zip(above, channels[:-1], PROPAGATION, strict=True)
        )
        self.head = nn.Linear(PROPAGATION[0], FEATURES)

    def forward(self, batch: Batch) -> Tensor:
        features = [batch.points[0]]
        for level, step in enumerate(self.down):
            features.append(step(batch, level, features[-1]))
        top = features.pop()
        whole = self.whole(top).reshape(batch.clouds, -1, GLOBAL).amax(dim=1)
        f = torch.cat([top, whole.repeat_interleave(batch.sizes[-1], dim=0)], dim=1)
        for level in reversed(range(len(self.up))):
            spread = (nn.functional.embedding(batch.anchors[level], f) * batch.weights[level][..., None]).sum(dim=1)
            f = self.up[level](torch.cat([spread, features[level]], dim=1))
        return self.head(f).reshape(batch.clouds, batch.sizes[0], FEATURES)
