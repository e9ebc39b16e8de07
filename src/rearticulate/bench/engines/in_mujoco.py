"""MuJoCo, for URDF and MJCF (https://mujoco.readthedocs.io)."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.bench.engines.engine import Pair, deepest

mujoco: Any = import_module("mujoco")  # has no types


class MujocoEngine:
    """See `Engine`. A URDF has no drives."""

    def __init__(self, path: Path) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.gravity = np.array(self.model.opt.gravity)
        self.names = [self.model.body(self.model.geom_bodyid[i]).name for i in range(self.model.ngeom)]

    def contacts(self, q: Mapping[str, float]) -> dict[Pair, float]:
        mujoco.mj_resetData(self.model, self.data)
        for name, value in q.items():
            self.data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        found: dict[Pair, float] = {}
        for contact in self.data.contact:
            deepest(found, self.names[contact.geom1], self.names[contact.geom2], -contact.dist)
        return found

    def run(self, seconds: float, *, gravity: bool, driven: bool) -> float:
        model, data = self.model, self.data
        model.opt.gravity[:] = self.gravity if gravity else 0.0
        off = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        model.opt.disableflags = model.opt.disableflags & ~off if driven else model.opt.disableflags | off
        mujoco.mj_resetData(model, data)
        moved = 0.0
        for _ in range(round(seconds / model.opt.timestep)):
            mujoco.mj_step(model, data)
            moved = max(moved, float(np.abs(data.qpos).max(initial=0.0)))
        return moved
