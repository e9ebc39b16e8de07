"""Make the bundled sequences: `python scripts/make_bundled_data.py ROBOTS SIDEBOARD`.

ROBOTS is the folder that `package://` stands for in example-robot-data, SIDEBOARD a folder written by
`export_sideboard.py` (see there for its environment). Only the models come from other environments; this script runs
in the project's own, with the extra `simulate`:

    python -m venv robots
    robots/bin/pip install example-robot-data==6.0.0
    python scripts/make_bundled_data.py robots/lib/python3.*/site-packages/cmeel.prefix/share furniture/sideboard

The same command writes the same numbers.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from rearticulate.io.npz import save_arrays
from rearticulate.io.truth import save_truth
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth.simulate import simulate

DATA = Path(__file__).resolve().parents[1] / "src" / "rearticulate" / "data"
GRID = 2.0**-16  # metres: points are rounded to 0.015 mm, far below their spacing, as they pack better so


def g1(robots: Path) -> tuple[PointSequence, GroundTruth]:
    urdf = robots / "example-robot-data/robots/g1_description/urdf/g1_29dof_rev_1_0.urdf"
    return simulate(urdf, start="zero", merge_below=0.02, seed=3, package_dirs=[robots])


def so101(robots: Path) -> tuple[PointSequence, GroundTruth]:
    urdf = robots / "example-robot-data/robots/so_arm_description/urdf/so101.urdf"
    return simulate(urdf, start="middle", seed=2, package_dirs=[robots])


def sideboard(folder: Path) -> tuple[PointSequence, GroundTruth]:
    return simulate(folder / "sideboard.urdf", frames=6, step_deg=17, moving_root=True, seed=2)


def main(robots: Path, furniture: Path) -> None:
    recordings = {"g1": g1(robots), "so101": so101(robots), "sideboard": sideboard(furniture)}
    for name, (sequence, truth) in recordings.items():
        points = np.round(np.stack(sequence.points) / GRID) * GRID
        save_arrays(DATA / f"{name}.npz", {"points": points.astype(np.float32)}, compress=True)
        save_truth(DATA / f"{name}.truth.npz", truth)
        print(f"{name}: {points.shape[0]} frames of {points.shape[1]} points, {len(truth.parent)} parts")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
