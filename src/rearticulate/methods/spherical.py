"""Trees of ball joints: the paper's way beyond one degree of freedom, for humans and animals (supplement C).

E_3-DOF takes the place of E_1-DOF: how well a rotation about a fixed centre explains a relative motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.config import DeviationConfig
from rearticulate.geometry.kinematics import chain
from rearticulate.geometry.se3 import exp_se3, log_so3
from rearticulate.joints.tree import number_parts
from rearticulate.methods.deviation import Parts, centred, least_tree
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import Relaxed, register_to_fused
from rearticulate.records import JointDiagnostics

RIDGE = 1e-6  # keeps a centre that nothing determines near the part


@dataclass(frozen=True)
class BallTree:
    """parent: parents first; centre: of each ball; turn: rotation vectors."""

    parent: Int[Array, " P"]
    centre: Float[Array, "P 3"]
    turn: Float[Array, "F P 3"]
    T_root: Float[Array, "F 4 4"]

    @property
    def n_parts(self) -> int:
        return len(self.parent)

    def forward(self) -> Float[Array, "F P 4 4"]:
        """Part poses."""
        screws = np.concatenate([self.turn, np.cross(self.centre, self.turn)], axis=-1)
        return chain(self.parent, exp_se3(screws), self.T_root)


@dataclass(frozen=True)
class Balls:
    """Ball joints of B pairs: centre, turn, slip of the centre, its normals."""

    centre: Float[Array, "B 3"]
    turn: Float[Array, "B F 3"]
    slip: Float[Array, "B F 3"]
    normal: Float[Array, "B 3 3"]

    @property
    def cost(self) -> Float[Array, " B"]:
        """Sum of the squared slips."""
        return (self.slip**2).sum(axis=(1, 2))


def fit_balls(parts: Parts, a: Int[Array, " B"], b: Int[Array, " B"]) -> Balls:
    """The ball joint of each pair.

    Its centre is the point that moves least, in closed form; the rotations are those of the relative motions.
    """
    A, _ = parts.relative(a, b)
    R, t = A[..., :3, :3], A[..., :3, 3]
    M = np.eye(3) - R
    middle = np.stack([parts.points[parts.labels == p].mean(axis=0) for p in a])
    normal = np.einsum("bfji,bfjk->bik", M, M) + RIDGE * np.eye(3)
    right = np.einsum("bfji,bfj->bi", M, t) + RIDGE * middle
    centre = np.linalg.solve(normal, right[..., None])[..., 0]
    slip = t - np.einsum("bfij,bj->bfi", M, centre)
    return Balls(centre, log_so3(R), slip, normal)


def project_balls(
    frames: Frames, canonical: int, model: Relaxed, config: DeviationConfig, root: int
) -> tuple[BallTree, Int[Array, " M"], float]:
    """The tree of ball joints with the least E_spatial + E_3-DOF, the labels in its numbers, and that cost."""
    parts = centred(frames, canonical, model, config.radius)
    P = model.n_parts
    parent, child, cost = least_tree(parts, lambda a, b: parts.deviation(fit_balls(parts, a, b).cost), config, root)
    number, new_parent = number_parts({int(c): int(parent[c]) for c in child}, root, P)
    centre, turn = np.zeros((P, 3)), np.zeros((len(model.T), P, 3))
    if P > 1:
        balls = fit_balls(parts, child, parent[child])
        centre[number[child]] = balls.centre + parts.centre
        turn[:, number[child]] = np.swapaxes(balls.turn, 0, 1)
    tree = BallTree(new_parent, centre, turn, model.T[:, root].copy())
    return tree, number[model.labels], cost


def diagnose_balls(frames: Frames, canonical: int, tree: BallTree, labels: Int[Array, " M"]) -> list[JointDiagnostics]:
    """One record a part, lengths in metres: how far the centres slip when the parts are registered freely."""
    free = register_to_fused(frames, canonical, Relaxed(tree.forward(), labels))
    parts = centred(frames, canonical, free, 1.0)
    counts = np.bincount(parts.labels, minlength=tree.n_parts)
    out = [JointDiagnostics(None, 0.0, None, None, "", None, True)]
    angle = np.linalg.norm(tree.turn, axis=-1).max(axis=0)
    for j in range(1, tree.n_parts):
        if not counts[j]:
            out.append(JointDiagnostics(None, float(angle[j]), None, None, "", None, False, "no points of its own"))
            continue
        ball = fit_balls(parts, np.array([j]), tree.parent[j : j + 1])
        slip = frames.unit * float(np.sqrt(ball.cost[0] / max(1, len(tree.turn) - 1)))
        spread = slip * float(np.sqrt(np.trace(np.linalg.inv(ball.normal[0]))))
        out.append(JointDiagnostics(slip, float(angle[j]), None, spread, "", None, True))
    return out
