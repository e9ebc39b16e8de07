"""The network at work, in NumPy: no fit needs a learning framework. Equal to `pointnet.CorrespondenceNet`, by test."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load_file

from rearticulate.errors import InputError
from rearticulate.network.pyramid import RADII, Pyramid, level_sizes

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

SHIPPED = Path(__file__).resolve().parent / "correspondence.safetensors"
EPSILON = 1e-5  # of the layer normalisation


class Network:
    """Weights by the names that training gave them."""

    def __init__(self, weights: dict[str, Array]) -> None:
        self._weights = {name: np.asarray(w, dtype=np.float32) for name, w in weights.items()}

    def features(self, pyramid: Pyramid) -> Array:
        """(N, 64) features of the points of a cloud, in the order of its pyramid."""
        sizes = level_sizes(len(pyramid.points))
        levels = [pyramid.points]
        for level, radius in enumerate(RADII):
            here, centres = pyramid.points[: sizes[level]], pyramid.points[: sizes[level + 1]]
            f, name = levels[-1], f"down.{level}"
            near = self._scale(f"{name}.near", here, f, centres, pyramid.near[level], radius)
            wide = self._scale(f"{name}.wide", centres, f[: len(centres)], centres, pyramid.wide[level], 2 * radius)
            levels.append(np.concatenate([near, wide], axis=1))
        top = levels.pop()
        whole = self._layers("whole", top).max(axis=0)
        f = np.concatenate([top, np.broadcast_to(whole, (len(top), len(whole)))], axis=1)
        for level in reversed(range(len(levels))):
            spread = np.einsum("nk,nkc->nc", pyramid.weights[level], f[pyramid.anchors[level]])
            f = self._layers(f"up.{level}", np.concatenate([spread, levels[level]], axis=1))
        return f @ self._weights["head.weight"].T + self._weights["head.bias"]

    def _scale(self, name: str, points: Array, f: Array, centres: Array, rows: IntArray, radius: float) -> Array:
        """The largest of each channel over the neighbours rows (m, K) of the centres (m, 3)."""
        offset = self._weights[f"{name}.offset.weight"].T / np.float32(radius)
        source = f @ self._weights[f"{name}.feature.weight"].T + points @ offset
        grouped = source[rows] - (centres @ offset)[:, None]
        return self._layers(f"{name}.rest", self._normalised(f"{name}.first.0", grouped)).max(axis=1)

    def _layers(self, name: str, x: Array) -> Array:
        k = 0
        while f"{name}.{k}.0.weight" in self._weights:
            x = self._normalised(f"{name}.{k}.1", x @ self._weights[f"{name}.{k}.0.weight"].T)
            k += 1
        return x

    def _normalised(self, name: str, x: Array) -> Array:
        """Layer normalisation and rectification."""
        x = x - x.mean(axis=-1, keepdims=True)
        x /= np.sqrt(np.einsum("...c,...c->...", x, x)[..., None] / x.shape[-1] + np.float32(EPSILON))
        return np.maximum(x * self._weights[f"{name}.weight"] + self._weights[f"{name}.bias"], 0.0)


def load_network(path: Path = SHIPPED) -> Network:
    """The network with the weights of a file, the shipped ones by default. Raises InputError if it cannot be read."""
    try:
        weights = load_file(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file of weights") from None
    except Exception as error:  # the library raises a type of its own for each kind of damage
        raise InputError(f"{path}: not a file of weights that can be read ({error})") from None
    if "head.weight" not in weights:
        raise InputError(f"{path}: the weights of something else, not of the correspondence network")
    return Network(weights)
