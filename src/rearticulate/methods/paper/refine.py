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
from rearticulate.geometry.se3 import exp_se3, log_so3
from rearticulate.joints.articulated import Articulated
from rearticulate.methods.paper.field import cosine
from rearticulate.methods.paper.poses import from_matrices, move, rotations, to_matrices, with_identity
from rearticulate.methods.paper.relax import Scene, chamfer_term, emd_term, flow_term, make_scene, total
from rearticulate.methods.spherical import BallTree
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import Frames

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]


class Tree(nn.Module):
    """A tree of joints in a scene, with free poses of its root (F - 1, 9): of all frames but the canonical one."""

    def __init__(self, parent: IntArray, T_root: Array, labels: IntArray, scene: Scene):
        super().__init__()
        self.scene, self.parent = scene, parent.tolist()
        self.points = scene.tensor(scene.canonical_points)
        self.weights = torch.nn.functional.one_hot(scene.tensor(labels), len(parent)).float()
        self.others = np.arange(len(T_root)) != scene.canonical
        self.root = nn.Parameter(from_matrices(scene.tensor(scene.poses_in(T_root)[self.others])).float())

    def steps(self) -> Tensor:
        """(F - 1, P, 3, 4) motion of every part against its parent; the root's own has no effect."""
        raise NotImplementedError

    def matrices(self) -> Tensor:
        """(F, P, 3, 4) part poses, the identity at the canonical frame."""
        steps = self.steps()
        T = [to_matrices(self.root)]
        for j in range(1, len(self.parent)):
            T.append(compose(T[self.parent[j]], steps[:, j]))
        return with_identity(torch.stack(T, dim=1), self.scene.canonical)

    def forward(self) -> Tensor:
        """(F, N, 3) moved canonical points."""
        return move(self.matrices(), self.weights, self.points)

    def all_frames(self, values: Array) -> Array:
        """(F, ...) values (F - 1, ...) with zeros at the canonical frame."""
        out = np.zeros((len(self.others), *values.shape[1:]))
        out[self.others] = values
        return out

    def T_root(self) -> Array:
        """(F, 4, 4) root poses in the frames' units."""
        T = np.tile(np.eye(4), (len(self.others), 1, 1))
        T[self.others, :3] = _read(to_matrices(self.root.double()))
        return self.scene.poses_out(T)


class ScrewTree(Tree):
    """Hinges and slides: axis, origin (P, 3), q (F - 1, P)."""

    def __init__(self, tree: Articulated, labels: IntArray, scene: Scene):
        super().__init__(tree.parent, tree.T_root, labels, scene)
        self.lengths = np.where(tree.revolute, 1.0, scene.scale)
        self.turning = scene.tensor(tree.revolute).float()
        self.axis = _parameter(scene, tree.axes)
        self.origin = _parameter(scene, scene.scale * (tree.feet - scene.centre))
        self.q = _parameter(scene, (tree.q * self.lengths)[self.others])

    def steps(self) -> Tensor:
        return screw_steps(nn.functional.normalize(self.axis, dim=1), self.origin, self.q, self.turning)

    def read(self, tree: Articulated) -> Articulated:
        """The tree with the present screws, joint values and root poses, in the frames' units."""
        axis = _read(nn.functional.normalize(self.axis.double(), dim=1))
        origin = _read(self.origin) / self.scene.scale + self.scene.centre
        turning = tree.revolute[:, None]
        twist = np.concatenate([np.where(turning, axis, 0.0), np.where(turning, np.cross(origin, axis), axis)], axis=1)
        q = self.all_frames(_read(self.q) / self.lengths)
        twist[0], q[:, 0] = 0.0, 0.0
        return replace(tree, twist=twist, q=q, T_root=self.T_root())


class BallJoints(Tree):
    """Ball joints: centre (P, 3), turn (F - 1, P, 6), a rotation as six numbers."""

    def __init__(self, tree: BallTree, labels: IntArray, scene: Scene):
        super().__init__(tree.parent, tree.T_root, labels, scene)
        self.centre = _parameter(scene, scene.scale * (tree.centre - scene.centre))
        R = exp_se3(np.concatenate([tree.turn, np.zeros_like(tree.turn)], axis=-1))
        self.turn = nn.Parameter(from_matrices(scene.tensor(R[self.others])).float()[..., :6])

    def steps(self) -> Tensor:
        R = rotations(self.turn)
        return torch.cat([R, self.centre[:, :, None] - R @ self.centre[:, :, None]], dim=-1)

    def read(self, tree: BallTree) -> BallTree:
        """The tree with the present centres, rotations and root poses, in the frames' units."""
        centre = _read(self.centre) / self.scene.scale + self.scene.centre
        turn = self.all_frames(log_so3(_read(rotations(self.turn.double()))))
        centre[0], turn[:, 0] = 0.0, 0.0
        return replace(tree, centre=centre, turn=turn, T_root=self.T_root())


def _read(values: Tensor) -> Array:
    return values.detach().double().numpy(force=True)


def _parameter(scene: Scene, values: Array) -> nn.Parameter:
    return nn.Parameter(scene.tensor(np.asarray(values, dtype=np.float32)))


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
    R = torch.eye(3, dtype=q.dtype, device=q.device) + angle.sin() * K + (1 - angle.cos()) * (K @ K)
    shift = origin[:, :, None] - R @ origin[:, :, None] + (q * (1 - turning))[..., None, None] * axis[:, :, None]
    return torch.cat([R, shift], dim=-1)


def refine(
    frames: Frames,
    canonical: int,
    tree: Articulated | BallTree,
    labels: IntArray,
    flow: Sequence[SceneFlow],
    config: NeuralConfig,
    progress: Callable[[str, float], None],
    device: str = "cpu",
) -> Articulated | BallTree:
    """Adam over the joints, their values and the root poses on all three energy terms; labels (M,) stay."""
    scene = make_scene(frames, canonical, flow, config.radius, device)
    own = labels[frames.rows(canonical)]
    with threadpool_limits(1):
        if isinstance(tree, BallTree):
            balls = BallJoints(tree, own, scene)
            descend(balls, scene, config, progress)
            return balls.read(tree)
        screws = ScrewTree(tree, own, scene)
        descend(screws, scene, config, progress)
        return screws.read(tree)


def descend(model: Tree, scene: Scene, config: NeuralConfig, progress: Callable[[str, float], None]) -> None:
    """The iterations of the final fit."""
    exact = replace(config, emd_thinning=config.final_thinning, emd_every=config.final_every)
    weighted = ((config.chamfer, chamfer_term), (config.emd, emd_term), (config.flow, flow_term))
    energy = total(*(make(scene, exact) for weight, make in weighted if weight))
    optimiser = torch.optim.Adam(model.parameters(), foreach=True)
    for i in range(config.final_iterations):
        progress("refine", i / config.final_iterations)
        for group in optimiser.param_groups:
            group["lr"] = cosine(config.final_rate, config.final_rate_end, i / config.final_iterations)
        optimiser.zero_grad()
        energy(model()).backward()
        optimiser.step()
