"""The examples, run as a user runs them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rearticulate.io import load_result, load_sequence, load_truth, save_truth
from rearticulate.io.palette import part_colors
from rearticulate.io.ply import write_cloud
from rearticulate.synth import bundled

EXAMPLES = Path(__file__).parents[1] / "examples"
HELD_OUT, EVERY = 3, 2  # frame; points that are taken


def example(name: str, *arguments: object) -> list[str]:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled sideboard without one frame, and every other point, from PLY files to a URDF."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "scans").mkdir()
    for f, points in enumerate(load_sequence(bundled.path("sideboard")).points):
        some = points[::EVERY]
        if f != HELD_OUT:
            write_cloud(folder / "scans" / f"frame_{f}.ply", some, np.tile(part_colors(1), (len(some), 1)))
    (line,) = example("ply_to_urdf", folder / "scans", folder / "out")
    assert line.startswith("5 parts")
    return folder / "out"


def test_own_scans_become_a_urdf(fitted: Path) -> None:
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(fitted / "export" / "robot.urdf"))
    assert model.njnt == 4


def test_clicks_move_it(fitted: Path) -> None:
    *joints, last = example("retarget_by_clicks", fitted)
    assert len(joints) == 4 and last.startswith("the clicks miss by")


def test_mujoco_drives_it(fitted: Path) -> None:
    lines = example("drive_in_mujoco", fitted / "export")
    assert len(lines) == 4
    spans = [abs(float(line.split()[-1]) - float(line.split()[-3])) for line in lines]
    assert min(spans) > 0.02


def test_a_new_scan_is_labelled(fitted: Path, tmp_path: Path) -> None:
    sequence, truth = load_sequence(bundled.path("sideboard")), load_truth(bundled.truth_path("sideboard"))
    np.savetxt(tmp_path / "new.xyz", sequence.points[HELD_OUT])
    *_, last = example("label_new_scan", fitted, tmp_path / "new.xyz", tmp_path / "labels.npy")
    assert last.startswith("points lie")
    found, true = np.load(tmp_path / "labels.npy"), truth.labels[HELD_OUT][sequence.index[HELD_OUT]]
    best = [np.bincount(true[found == p]).max() for p in np.unique(found)]
    assert sum(best) / len(true) > 0.8


def test_a_fit_is_compared_with_truth(fitted: Path, tmp_path: Path) -> None:
    truth = load_truth(bundled.truth_path("sideboard"))
    kept = [f for f in range(len(truth.labels)) if f != HELD_OUT]
    state = None if truth.joint_state is None else truth.joint_state[kept]
    labels = tuple(truth.labels[f][::EVERY] for f in kept)
    fewer = replace(truth, labels=labels, poses=truth.poses[kept], joint_state=state)
    save_truth(tmp_path / "fewer.truth.npz", fewer)
    lines = example("compare_with_truth", fitted, tmp_path / "fewer.truth.npz")
    recon = next(float(line.split()[1]) for line in lines if line.startswith("recon_cm"))
    assert recon < 2.0 and load_result(fitted).model.n_parts == 5
