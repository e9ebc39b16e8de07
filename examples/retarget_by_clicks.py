"""Drag one point of a fitted object and keep another where it is: python retarget_by_clicks.py OUT

The point at the end of the longest chain goes a tenth of the object's size up; its part's joints follow.
"""

import sys

import numpy as np

import rearticulate

if __name__ == "__main__":
    model = rearticulate.load_model(sys.argv[1])
    size = np.linalg.norm(np.ptp(model.points, axis=0))

    last = model.points[model.labels == model.n_parts - 1]
    root = model.points[model.labels == 0]
    clicked = np.stack([last[0], *root[:3]])
    wanted = clicked + np.array([[0, 0, 0.1 * size], [0, 0, 0], [0, 0, 0], [0, 0, 0]])

    found = rearticulate.retarget(model, clicked, wanted)
    for name, value, kind in zip(model.names[1:], found.q[1:], model.joint_type[1:], strict=True):
        print(f"{name}: {value:+.3f} {'m' if kind == 'prismatic' else 'rad'}")
    print(f"the clicks miss by {1000 * found.residual.max():.1f} mm at most")
