"""Newton, for USD, on the CPU (https://newton-physics.github.io; needs newton-usd-schemas)."""

# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.bench.engines.engine import Pair, deepest

newton: Any = import_module("newton")
import_module("newton_usd_schemas")

STEP, FINE_STEP = 1e-3, 2e-4  # s; the second under drives, which it integrates explicitly


class NewtonEngine:
    """See `Engine`. Joint coordinates, integrated by Featherstone's algorithm."""

    def __init__(self, path: Path) -> None:
        builder = newton.ModelBuilder()
        told = builder.add_usd(str(path), load_visual_shapes=False)
        self.model = builder.finalize(device="cpu")
        self.gravity = np.array(self.model.gravity.numpy())
        start = self.model.joint_q_start.numpy()
        self.joints = {str(name).rsplit("/", 1)[-1]: start[j] for name, j in told["path_joint_map"].items()}
        bodies = {number: str(name).rsplit("/", 1)[-1] for name, number in told["path_body_map"].items()}
        self.links = [bodies.get(number, "") for number in self.model.shape_body.numpy()]
        self.pipeline = newton.CollisionPipeline(self.model)
        self.found = self.pipeline.contacts()
        self.stiffness, self.damping = (
            np.array(gains.numpy()) for gains in (self.model.joint_target_ke, self.model.joint_target_kd)
        )

    def _state(self, q: Mapping[str, float]) -> Any:
        values = np.zeros(self.model.joint_coord_count, dtype=np.float32)
        for name, value in q.items():
            values[self.joints[name]] = value
        state = self.model.state()
        state.joint_q.assign(values)
        newton.eval_fk(self.model, state.joint_q, state.joint_qd, state)
        return state

    def contacts(self, q: Mapping[str, float]) -> dict[Pair, float]:
        state = self._state(q)
        self.pipeline.collide(state, self.found)
        contacts, poses = self.found, state.body_q.numpy()
        count = int(contacts.rigid_contact_count.numpy()[0])
        shapes = [side.numpy()[:count] for side in (contacts.rigid_contact_shape0, contacts.rigid_contact_shape1)]
        bodies = self.model.shape_body.numpy()
        points = [side.numpy()[:count] for side in (contacts.rigid_contact_point0, contacts.rigid_contact_point1)]
        one, two = (_moved(poses[bodies[own]], at) for own, at in zip(shapes, points, strict=True))
        apart = np.einsum("ci,ci->c", two - one, contacts.rigid_contact_normal.numpy()[:count])
        apart -= contacts.rigid_contact_margin0.numpy()[:count] + contacts.rigid_contact_margin1.numpy()[:count]
        deep: dict[Pair, float] = {}
        for a, b, distance in zip(*shapes, apart, strict=True):
            deepest(deep, self.links[a], self.links[b], -float(distance))
        return deep

    def run(self, seconds: float, *, gravity: bool, driven: bool) -> float:
        model = self.model
        model.gravity.assign(self.gravity if gravity else 0 * self.gravity)
        model.joint_target_ke.assign(self.stiffness if driven else 0 * self.stiffness)
        model.joint_target_kd.assign(self.damping if driven else 0 * self.damping)
        solver, control = newton.solvers.SolverFeatherstone(model), model.control()
        now, after, moved = self._state({}), model.state(), 0.0
        step = FINE_STEP if driven else STEP
        for _ in range(round(seconds / step)):
            now.clear_forces()
            self.pipeline.collide(now, self.found)
            solver.step(now, after, control, self.found, step)
            now, after = after, now
            moved = max(moved, float(np.abs(now.joint_q.numpy()).max(initial=0.0)))
        return moved


def _moved(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (c, 3) by poses (c, 7), position and quaternion xyzw."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(poses[:, 3:]).apply(points) + poses[:, :3]
