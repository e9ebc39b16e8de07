"""Load an exported object into MuJoCo and drive its joints through their ranges: python drive_in_mujoco.py OUT/export

Needs the package mujoco. OUT/export is what `rearticulate export OUT` wrote.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

if __name__ == "__main__":
    (file,) = Path(sys.argv[1]).glob("*.xml")
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    low, high = model.actuator_ctrlrange.T
    reached = []
    for step in range(4000):
        share = 0.5 - 0.5 * np.cos(2 * np.pi * step / 4000)  # there and back
        data.ctrl[:] = low + share * (high - low)
        mujoco.mj_step(model, data)
        reached.append(data.qpos.copy())
    for j in range(model.njnt):
        way = np.array(reached)[:, model.jnt_qposadr[j]]
        print(f"{model.joint(j).name}: driven from {way.min():+.3f} to {way.max():+.3f}")
