"""The network at work: correspondences between clouds, and the scene flow of a sequence from them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rearticulate.errors import InputError
from rearticulate.network.matching import mutual_matches
from rearticulate.network.pointnet import Batch, CorrespondenceNet
from rearticulate.network.pyramid import MIN_POINTS, build_pyramid, rms_radius

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

RATIO = 0.9  # of the distances in feature space to the nearest and the second nearest (see `mutual_matches`)


@torch.no_grad()
def point_features(net: CorrespondenceNet, cloud: Array, scale: float) -> Tensor:
    """(N, 64) features of a cloud (N, 3), in units of scale, in its own order."""
    if len(cloud) < MIN_POINTS:
        raise InputError(f"the correspondence network needs {MIN_POINTS} points a frame, one has {len(cloud)}")
    pyramid = build_pyramid(cloud, scale)
    features = net(Batch([pyramid]))[0]
    return features[torch.from_numpy(np.argsort(pyramid.order))]


def match_sequence(
    net: CorrespondenceNet, clouds: Sequence[Array], ratio: float = RATIO
) -> list[tuple[IntArray, IntArray]]:
    """For every two successive clouds the rows (K,) of the first and (K,) of the second that correspond."""
    scale = float(np.mean([rms_radius(cloud) for cloud in clouds]))
    features = [point_features(net, cloud, scale) for cloud in clouds]
    matches = [mutual_matches(a, b, ratio) for a, b in pairwise(features)]
    return [(i.numpy(), j.numpy()) for i, j in matches]
