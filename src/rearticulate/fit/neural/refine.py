"""Final fit: screws, joint values and root poses under a given tree, by gradient descent (paper, sec. 3.3.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from torch import Tensor, nn

from rearticulate.config import NeuralConfig
from rearticulate.fit.articulated import Articulated
from rearticulate.fit.flow import SceneFlow
from rearticulate.fit.frames import Frames
from rearticulate.fit.neural.field import cosine
from rearticulate.fit.neural.poses import from_matrices, move, to_matrices
from rearticulate.fit.neural.relax import Scene, chamfer_term, emd_term, flow_term, make_scene

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


class Tree(nn.Module):
    """A tree of screws in a scene. axis, origin (P, 3), q (F - 1, P), root (F - 1, 9): of all frames but the canonical.

    The root's own axis, origin and joint value have no effect.
    """

    def __init__(self, tree: Articulated, labels: IntArray, scene: Scene):
        super().__init__()
        self.canonical, self.parent = scene.canonical, tree.parent.tolist()
        self.points = torch.from_numpy(scene.canonical_points)
        self.weights = torch.nn.functional.one_hot(torch.from_numpy(labels), tree.n_parts).float()
        self.turning = torch.from_numpy(tree.revolute).float()
        lengths = np.where(tree.revolute, 1.0, scene.scale)
        others = np.arange(len(tree.q)) != scene.canonical
        self.axis = _parameter(tree.axes)
        self.origin = _parameter(scene.scale * (tree.feet - scene.centre))
        self.q = _parameter((tree.q * lengths)[others])
        self.root = nn.Parameter(from_matrices(torch.from_numpy(scene.poses_in(tree.T_root)[others])).float())

    def matrices(self) -> Tensor:
        """(F, P, 3, 4) part poses, the identity at the canonical frame."""
        steps = screw_steps(nn.functional.normalize(self.axis, dim=1), self.origin, self.q, self.turning)
        T = [to_matrices(self.root)]
        for j in range(1, len(self.parent)):
            T.append(compose(T[self.parent[j]], steps[:, j]))
        moving, c = torch.stack(T, dim=1), self.canonical
        return torch.cat([moving[:c], torch.eye(3, 4).expand(1, len(T), 3, 4), moving[c:]])

    def forward(self) -> Tensor:
        """(F, N, 3) moved canonical points."""
        return move(self.matrices(), self.weights, self.points)

    def read(self, tree: Articulated, scene: Scene) -> Articulated:
        """The tree with the present screws, joint values and root poses, in the frames' units."""
        with torch.no_grad():
            axis = nn.functional.normalize(self.axis.double(), dim=1).numpy()
            origin = self.origin.double().numpy() / scene.scale + scene.centre
            q = self.q.double().numpy() / np.where(tree.revolute, 1.0, scene.scale)
            root = to_matrices(self.root.double()).numpy()
        others = np.arange(len(tree.q)) != scene.canonical
        turning = tree.revolute[:, None]
        twist = np.concatenate([np.where(turning, axis, 0.0), np.where(turning, np.cross(origin, axis), axis)], axis=1)
        twist[0], q[:, 0] = 0.0, 0.0
        values, T_root = np.zeros_like(tree.q), np.tile(np.eye(4), (len(tree.q), 1, 1))
        values[others] = q
        T_root[others, :3] = root
        return replace(tree, twist=twist, q=values, T_root=scene.poses_out(T_root))


def _parameter(values: Array) -> nn.Parameter:
    return nn.Parameter(torch.from_numpy(np.asarray(values, dtype=np.float32)))


def compose(a: Tensor, b: Tensor) -> Tensor:
    """(..., 3, 4) motion b followed by motion a."""
    return torch.cat([a[..., :3] @ b[..., :3], a[..., :3] @ b[..., 3:] + a[..., 3:]], dim=-1)


def screw_steps(axis: Tensor, origin: Tensor, q: Tensor, turning: Tensor) -> Tensor:
    """(F, P, 3, 4) motions of joints about unit axis (P, 3) through origin (P, 3) at values q (F, P) (paper eq. 3).

    turning (P,): 1 where the joint turns by q, 0 where it slides by q.
    """
    zero = torch.zeros_like(axis[:, 0])
    x, y, z = axis.unbind(dim=1)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
    angle = (q * turning)[..., None, None]
    R = torch.eye(3, dtype=q.dtype) + angle.sin() * K + (1 - angle.cos()) * (K @ K)
    shift = origin[:, :, None] - R @ origin[:, :, None] + (q * (1 - turning))[..., None, None] * axis[:, :, None]
    return torch.cat([R, shift], dim=-1)


def refine(
    frames: Frames,
    canonical: int,
    tree: Articulated,
    labels: IntArray,
    flow: Sequence[SceneFlow],
    config: NeuralConfig,
    progress: Callable[[str, float], None],
) -> Articulated:
    """Adam over the screws, the joint values and the root poses on all three energy terms; labels (M,) stay."""
    scene = make_scene(frames, canonical, flow, config.radius)
    exact = replace(config, emd_thinning=config.final_thinning, emd_every=config.final_every)
    with threadpool_limits(1):
        model = Tree(tree, labels[frames.rows(canonical)], scene)
        optimiser = torch.optim.Adam(model.parameters(), foreach=True)
        weighted = ((config.chamfer, chamfer_term), (config.emd, emd_term), (config.flow, flow_term))
        terms = [make(scene, exact) for weight, make in weighted if weight]
        for i in range(config.final_iterations):
            progress("refine", i / config.final_iterations)
            for group in optimiser.param_groups:
                group["lr"] = cosine(config.final_rate, config.final_rate_end, i / config.final_iterations)
            optimiser.zero_grad()
            x = model()
            torch.stack([term(x) for term in terms]).sum().backward()
            optimiser.step()
        return model.read(tree, scene)
