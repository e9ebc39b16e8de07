"""URDF to 4D point cloud, by the protocol of the RoboArt set."""

from __future__ import annotations

import os
from typing import Annotated

from rearticulate.bounds import Bounds, Seed, Share, checked
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth.articulated import record
from rearticulate.synth.trajectories import Start
from rearticulate.synth.urdf import Folders, load_urdf


@checked
def simulate(
    urdf_path: str | os.PathLike[str],
    *,
    frames: Annotated[int, Bounds(1, 10**5)] = 10,
    points: Annotated[int, Bounds(1, 10**7)] = 4096,
    step_deg: Annotated[float, Bounds(0, 360)] = 10.0,
    step_m: Annotated[float, Bounds(0, 1e6)] | None = None,
    start: Start = "random",
    noise: Annotated[float, Bounds(0, 1e6)] = 0.0,
    one_sided: bool = False,
    moving_root: bool = False,
    novel: Annotated[int, Bounds(0, 10**5)] = 3,
    merge_below: Share = 0.015,
    seed: Seed = 0,
    package_dirs: Folders = (),
) -> tuple[PointSequence, GroundTruth]:
    """Record the robot or object of a URDF in motion; needs the extra `simulate`.

    frames, points: size of the sequence; every frame is sampled afresh over the area of all visual geometry.
    step_deg:      degrees that a joint turns a frame, within 20 %, turning round at its limits.
    step_m:        metres that a prismatic joint slides a frame; by default the share step_deg / 180 of its range.
    start:         posture of frame 0: "random" or "middle" of the limits, or "zero" (the nearest within them).
    noise:         standard deviation of each coordinate, metres.
    one_sided:     keep only what one camera, fixed in a random direction, can see.
    moving_root:   the root wanders: 5 degrees and 1 % of the object's diagonal a frame.
    novel:         number of random novel postures in the ground truth.
    merge_below:   parts with less than this share of the surface are merged with their parents (see `load_urdf`).
    package_dirs:  folders that hold the packages of `package://` file names.
    """
    thing = load_urdf(urdf_path, package_dirs=package_dirs, merge_below=merge_below)
    return record(
        thing,
        frames=frames,
        points=points,
        step_deg=step_deg,
        step_m=step_m,
        start=start,
        noise=noise,
        one_sided=one_sided,
        moving_root=moving_root,
        novel=novel,
        seed=seed,
    )
