"""A figure with ball joints: a trunk with limbs that turn about their ends in every direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.kinematics import chain
from rearticulate.geometry.se3 import exp_se3, transform
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth.articulated import record_poses
from rearticulate.synth.surfaces import box

Array = NDArray[np.floating]

PARENT = np.array([-1, 0, 0, 0, 1, 2])
CENTRE = np.array([[0, 0, 0], [0.22, 0, 0.5], [-0.22, 0, 0.5], [0, 0, 0.62], [0.52, 0, 0.5], [-0.52, 0, 0.5]])
SIZES = ((0.4, 0.24, 0.6), (0.26, 0.1, 0.12), (0.26, 0.12, 0.1), (0.18, 0.22, 0.26), (0.3, 0.06, 0.1), (0.3, 0.1, 0.07))
MIDDLE = ((0, 0, 0.3), (0.37, 0, 0.5), (-0.37, 0, 0.5), (0.02, 0, 0.76), (0.69, 0.01, 0.5), (-0.69, 0, 0.51))


def record_figure(
    *, frames: int = 10, points: int = 4096, step_deg: float = 10.0, seed: int = 0
) -> tuple[PointSequence, GroundTruth, Array]:
    """A trunk, a head, two arms of two parts: every joint swings about two random axes at its own pace, about step_deg
    a frame; the trunk stands still. Returns the recording and where the joints' centres are in frame 0, (P, 3)."""
    rng = np.random.default_rng(seed)
    P = len(PARENT)
    axes = np.linalg.qr(rng.normal(size=(P, 3, 3)))[0][:, :2]
    phase, pace = rng.uniform(0, 2 * np.pi, (2, P)), rng.uniform(0.8, 1.2, (2, P)) * np.pi / 5
    time = np.arange(frames)[:, None, None]
    swing = np.deg2rad(step_deg) / (np.pi / 5) * np.sin(phase + pace * time)  # (F, 2, P)
    turn = np.einsum("fkp,pkc->fpc", swing, axes)
    turn[:, 0] = 0.0
    T = chain(PARENT, exp_se3(np.concatenate([turn, np.cross(CENTRE, turn)], axis=-1)))
    surfaces = [box(size, middle) for size, middle in zip(SIZES, MIDDLE, strict=True)]
    return *record_poses(surfaces, PARENT, T, points=points, seed=seed), transform(T[0, PARENT.clip(min=0)], CENTRE)
