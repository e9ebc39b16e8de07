"""PyBullet, for URDF (https://pybullet.org). Parents and children collide too, unlike by its default."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import Any

from rearticulate.bench.engines.engine import Pair, deepest

bullet: Any = import_module("pybullet")  # has no types

STEP = 1 / 240  # s, its own


class BulletEngine:
    """See `Engine`. A URDF has no drives."""

    def __init__(self, path: Path) -> None:
        self.client = bullet.connect(bullet.DIRECT)
        flags = bullet.URDF_USE_SELF_COLLISION | bullet.URDF_USE_SELF_COLLISION_INCLUDE_PARENT
        self.body = bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self.client)
        told = [self._of(bullet.getJointInfo, j) for j in range(self._of(bullet.getNumJoints))]
        self.joints = {info[1].decode(): info[0] for info in told}
        self.moving = [info[0] for info in told if info[2] != bullet.JOINT_FIXED]
        self.links = {-1: self._of(bullet.getBodyInfo)[0].decode(), **{info[0]: info[12].decode() for info in told}}

    def _of(self, ask: Any, *arguments: Any, **options: Any) -> Any:
        return ask(self.body, *arguments, **options, physicsClientId=self.client)

    def _reset(self, q: Mapping[str, float]) -> None:
        for j in self.moving:
            self._of(bullet.resetJointState, j, 0.0)
        for name, value in q.items():
            self._of(bullet.resetJointState, self.joints[name], value)

    def contacts(self, q: Mapping[str, float]) -> dict[Pair, float]:
        self._reset(q)
        found: dict[Pair, float] = {}
        for a, b in combinations(self.links, 2):  # asked anew: its contacts remember the posture before
            for point in self._of(bullet.getClosestPoints, self.body, 0.0, a, b):
                deepest(found, self.links[a], self.links[b], -point[8])
        return found

    def run(self, seconds: float, *, gravity: bool, driven: bool) -> float:
        assert not gravity and not driven, "a URDF has no drives to hold it"
        self._reset({})
        for j in self.moving:
            self._of(bullet.setJointMotorControl2, j, bullet.VELOCITY_CONTROL, force=0.0)
        bullet.setGravity(0, 0, 0, physicsClientId=self.client)
        moved = 0.0
        for _ in range(round(seconds / STEP)):
            bullet.stepSimulation(physicsClientId=self.client)
            moved = max([moved, *(abs(self._of(bullet.getJointState, j)[0]) for j in self.moving)])
        return moved
