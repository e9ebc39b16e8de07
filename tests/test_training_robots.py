"""Robots to train on: none of those that are tested on, free licences, and models that hang together."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from rearticulate.errors import InputError
from rearticulate.synth.surfaces import areas
from rearticulate.training.robots import CATALOGUE, EXCLUDED, load_robot, training_robots

FREE = {"Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSD-3-Clause-Clear", "MIT", "MPL-2.0"}
QUICK = ("Atlas", "Laikago", "iiwa", "Human", "Robotiq2F85", "TriFingerEdu", "Minitaur")  # to load
INSTALLED = [robot for robot in CATALOGUE if robot.path is not None]
SOME_ROBOTS = pytest.mark.skipif(not INSTALLED, reason="no robots: pip install 'rearticulate[train]'")


def words(text: str) -> set[str]:
    """Lower-case words of a text, and what is left of each of them without its digits at the end."""
    found = set(re.findall(r"[a-z0-9]+", text.lower()))
    return found | {word.rstrip("0123456789") for word in found}


def test_names_are_unique_and_the_robots_of_the_paper_are_there():
    names = [robot.name for robot in CATALOGUE]
    assert len(set(names)) == len(names)
    assert {"Atlas", "Baxter", "Laikago", "iiwa"} <= set(names)


@pytest.mark.parametrize("robot", CATALOGUE, ids=lambda robot: robot.name)
def test_no_robot_of_the_benchmarks_is_trained_on(robot):
    assert not any(name in re.sub(r"[^a-z0-9]", "", robot.name.lower()) for name in EXCLUDED)
    assert not words(robot.urdf) & set(EXCLUDED)


@SOME_ROBOTS
@pytest.mark.parametrize("robot", INSTALLED, ids=lambda robot: robot.name)
def test_no_part_is_one_of_a_robot_of_the_benchmarks(robot):
    text = robot.path.read_text(encoding="utf-8")
    meshes = set(re.findall(r'filename="([^"]+\.(?:dae|stl|obj|glb))"', text, flags=re.IGNORECASE))
    assert not words(" ".join(meshes)) & set(EXCLUDED)


def test_the_exclusion_would_be_noticed():
    assert words("package://wonik_allegro/link_1.dae") & set(EXCLUDED)
    assert words("meshes/UR5e/base.stl ur5") & set(EXCLUDED) and words("meshes/panda_2/hand.stl") & set(EXCLUDED)


def test_every_licence_is_free():
    assert {robot.licence for robot in CATALOGUE} <= FREE


def test_packages_of_the_extra_and_packages_to_install_as_data_are_all_there_are():
    import rearticulate.training.robots as module

    extra = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    for package in {robot.package for robot in CATALOGUE}:
        assert f'"{package}>=' in extra or f"{package}==" in (module.__doc__ or "")


@pytest.mark.parametrize("name", QUICK)
def test_a_robot_hangs_together(name):
    robot = next(robot for robot in CATALOGUE if robot.name == name)
    if robot.path is None:
        pytest.skip(f"{robot.package} is not installed")
    thing = load_robot(robot)
    assert 5 <= thing.n_parts <= 25
    assert (thing.parent[1:] < np.arange(1, thing.n_parts)).all() and (thing.limits[1:, 0] < thing.limits[1:, 1]).all()
    np.testing.assert_allclose(np.linalg.norm(thing.axis[1:], axis=1), 1, atol=1e-12)
    assert min(areas(surface).sum() for surface in thing.surfaces) > 0
    size = np.ptp(np.concatenate(thing.surfaces).reshape(-1, 3), axis=0).max()
    assert 0.1 < size < 3
    for p in range(1, thing.n_parts):  # what is exploded has its joints far from its parts
        corners = thing.surfaces[p].reshape(-1, 3)
        assert np.linalg.norm(corners - thing.point[p], axis=1).min() < 0.15 * size


def test_without_any_package_the_extra_is_named(monkeypatch):
    monkeypatch.setattr("sys.path", [])
    with pytest.raises(InputError, match=r"rearticulate\[train\]"):
        training_robots()
