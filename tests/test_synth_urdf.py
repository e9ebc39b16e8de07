"""URDF to recordings: kinematics against yourdfpy and MuJoCo, merging, mesh look-up, clear errors."""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from rearticulate.errors import InputError
from rearticulate.geometry.se3 import inverse
from rearticulate.synth.simulate import simulate
from rearticulate.synth.surfaces import areas
from rearticulate.synth.urdf import load_urdf

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def link(name: str, geometry: str = '<box size="0.1 0.2 0.3"/>', origin: str = "") -> str:
    visual = f"<visual>{origin}<geometry>{geometry}</geometry></visual>" if geometry else ""
    return f'<link name="{name}">{INERTIAL}{visual}</link>'


def joint(parent: str, child: str, kind: str, *, axis="0 0 1", xyz="0 0 0", rpy="0 0 0", limit="-1 2", more="") -> str:
    low, high = limit.split()
    return (
        f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>{more}</joint>'
    )


def write(folder: Path, *elements: str) -> Path:
    path = folder / "robot.urdf"
    settings = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    path.write_text(f'<robot name="robot">{settings}{"".join(elements)}</robot>')
    return path


def robot_of(mesh: str) -> str:
    one = link("a", f'<mesh filename="{mesh}"/>')
    return f'<robot name="robot">{one}</robot>'


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """Every joint type, tilted joint frames, a fixed flange, a mimicking finger; parts of about the same size."""
    tilted = '<origin xyz="0.1 0 0.2" rpy="0.3 0 1"/>'
    return write(
        tmp_path,
        link("base"),
        link("turret", '<cylinder radius="0.1" length="0.4"/>', tilted),
        link("boom", '<sphere radius="0.12"/>'),
        link("flange"),
        link("left"),
        link("right"),
        joint("base", "turret", "continuous", axis="0 0 1", xyz="0 0 0.4", rpy="0.2 -0.4 1.2"),
        joint("turret", "boom", "revolute", axis="0.6 0.8 0", xyz="0.3 0.1 0", rpy="1 2 3"),
        joint("boom", "flange", "fixed", xyz="0 0.3 0.2", rpy="0 1 0"),
        joint("flange", "left", "prismatic", axis="0 1 0", xyz="0 0.2 0", rpy="0.5 0 0", limit="0.02 0.3"),
        joint("flange", "right", "prismatic", axis="0 -1 0", xyz="0 -0.2 0", limit="-1 1",
              more='<mimic joint="left_joint" multiplier="2" offset="0.05"/>'),
    )  # fmt: skip


def random_states(n: int) -> np.ndarray:
    """(n, 5) joint values of base, turret, boom, left, right of `robot`."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 2, (n, 5))
    q[:, 0], q[:, 3] = 0, rng.uniform(0.02, 0.3, n)
    return q


def test_poses_agree_with_yourdfpy(robot):
    thing = load_urdf(robot)
    assert thing.names == ("base", "turret", "boom", "left", "right")
    oracle = yourdfpy.URDF.load(str(robot))
    oracle.update_cfg(np.zeros(3))
    at_zero = np.stack([oracle.get_transform(name) for name in thing.names])
    T_rest = inverse(thing.forward(thing.follow(np.zeros(5)))) @ at_zero  # link frames in part coordinates
    for q in random_states(10):
        oracle.update_cfg(q[[1, 2, 3]])
        expected = np.stack([oracle.get_transform(name) for name in thing.names])
        np.testing.assert_allclose(thing.forward(thing.follow(q)) @ T_rest, expected, atol=1e-12)


def test_poses_agree_with_mujoco(robot):
    thing = load_urdf(robot)
    model = mujoco.MjModel.from_xml_path(str(robot))
    data = mujoco.MjData(model)

    def poses(q: np.ndarray) -> np.ndarray:
        for name, value in zip(thing.names[1:], q[1:], strict=True):
            data.qpos[model.joint(f"{name}_joint").qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        T = np.tile(np.eye(4), (4, 1, 1))
        for p, name in enumerate(thing.names[1:]):
            T[p, :3, :3], T[p, :3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
        return T

    at_zero = poses(np.zeros(5))
    for q in random_states(10):
        np.testing.assert_allclose(thing.forward(q)[1:] @ at_zero, poses(q), atol=1e-9)


def test_ground_truth_of_a_simulation(robot):
    sequence, truth = simulate(robot, frames=6, points=300, seed=1, novel=2)
    assert truth.joint_type == ("", "revolute", "revolute", "prismatic", "prismatic")
    assert truth.parent.tolist() == [-1, 0, 1, 2, 2]
    q = truth.joint_state
    assert (q[:, 3] >= 0.02).all() and (q[:, 3] <= 0.3).all()
    np.testing.assert_allclose(q[:, 4], 2 * q[:, 3] + 0.05)
    slide = np.abs(np.diff(q[:, 3]))
    assert (slide < 1.2 * 0.28 * 10 / 180 + 1e-12).all()
    oracle = yourdfpy.URDF.load(str(robot))
    moved = []
    for f in (0, 5):
        oracle.update_cfg(q[f, [1, 2, 3]])
        moved.append(np.stack([oracle.get_transform(name) for name in ("base", "turret", "boom", "left", "right")]))
    np.testing.assert_allclose(truth.poses[5], moved[1] @ inverse(moved[0]), atol=1e-12)
    np.testing.assert_allclose(truth.joint_point[1], moved[0][1][:3, 3], atol=1e-12)
    np.testing.assert_allclose(truth.joint_axis[2], moved[0][2][:3, :3] @ [0.6, 0.8, 0], atol=1e-12)
    assert len(sequence) == 6 and truth.novel.shape == (2, 5, 4, 4)


def test_points_of_a_simulation_lie_on_the_meshes_of_the_oracle(robot):
    sequence, truth = simulate(robot, frames=2, points=300, seed=2)
    oracle = yourdfpy.URDF.load(str(robot))
    oracle.update_cfg(truth.joint_state[1, [1, 2, 3]])
    scene = oracle.scene.to_mesh()
    assert trimesh.proximity.closest_point(scene, sequence.points[1])[1].max() < 2e-3  # how round are the round ones


def test_small_parts_are_merged_smallest_first(tmp_path):
    small, smaller = '<box size="0.01 0.01 0.01"/>', '<box size="0.005 0.005 0.005"/>'
    path = write(
        tmp_path,
        link("base"), link("arm"), link("hand", small), link("tip", smaller), link("empty", ""), link("end"),
        joint("base", "arm", "revolute"), joint("arm", "hand", "revolute"), joint("hand", "tip", "revolute"),
        joint("arm", "empty", "revolute"), joint("empty", "end", "revolute"),
    )  # fmt: skip
    assert load_urdf(path, merge_below=0).names == ("base", "arm", "hand", "tip", "end")
    merged = load_urdf(path, merge_below=0.01)
    assert merged.names == ("base", "arm", "end") and merged.parent.tolist() == [-1, 0, 1]
    assert areas(np.concatenate(merged.surfaces)).sum() == pytest.approx(3 * 0.22 + 6e-4 + 1.5e-4)


def test_an_empty_root_is_merged_with_its_largest_child(tmp_path):
    path = write(
        tmp_path, link("world", ""), link("left", '<box size="0.1 0.1 0.1"/>'), link("right"),
        joint("world", "left", "revolute"), joint("world", "right", "revolute"),
    )  # fmt: skip
    thing = load_urdf(path)
    assert thing.names == ("world", "left")
    assert [round(float(areas(s).sum()), 9) for s in thing.surfaces] == [0.22, 0.06]


def test_joints_that_cannot_move_are_held_at_their_nearest_value(tmp_path):
    path = write(
        tmp_path, link("base"), link("lid"), link("knob"),
        joint("base", "lid", "prismatic", axis="0 0 2", limit="0.4 0.4"), joint("lid", "knob", "floating"),
    )  # fmt: skip
    thing = load_urdf(path)
    assert thing.n_parts == 1
    assert thing.surfaces[0].reshape(-1, 3)[:, 2].max() == pytest.approx(0.4 + 0.15)


def test_mesh_scenes_are_baked_scaled_and_found_in_packages(tmp_path):
    scene = trimesh.Scene()
    scale_and_shift = np.diag([0.5, 0.5, 0.5, 1.0])
    scale_and_shift[0, 3] = 2.0
    scene.add_geometry(trimesh.creation.box((1, 1, 1)), transform=scale_and_shift)
    package = tmp_path / "shapes" / "meshes"
    package.mkdir(parents=True)
    scene.export(package / "cube.glb")
    home = tmp_path / "elsewhere"
    home.mkdir()
    path = write(home, link("base", '<mesh filename="package://shapes/meshes/cube.glb" scale="2 2 2"/>'))
    for folders in ([tmp_path], [tmp_path / "shapes"], []):  # found above the URDF, too
        corners = load_urdf(path, package_dirs=folders).surfaces[0].reshape(-1, 3)
        np.testing.assert_allclose(corners.min(axis=0), [3.5, -0.5, -0.5], atol=1e-6)
        np.testing.assert_allclose(corners.max(axis=0), [4.5, 0.5, 0.5], atol=1e-6)


def test_one_sided_and_moving_root_reach_the_recording(robot):
    sequence, truth = simulate(robot, frames=2, points=200, one_sided=True, moving_root=True, start="zero", noise=0.001)
    assert [len(p) for p in sequence.points] == [200, 200]
    assert np.abs(truth.poses[1, 0] - np.eye(4)).max() > 0.01
    assert truth.joint_state[0].tolist() == pytest.approx([0, 0, 0, 0.02, 0.09])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such URDF file"),
        ("nonsense", "not a URDF"),
        ('<robot name="r"><link name="a"/><link name="b"/></robot>', "has 2: a, b"),
        ('<robot name="r"><link name="a"/></robot>', "no visual geometry"),
        (robot_of("package://p/m.stl"), "p/m.stl not found"),
        (robot_of("broken.stl"), "not a mesh"),
    ],
)
def test_errors_say_what_is_wrong(tmp_path, text, message):
    path = tmp_path / "robot.urdf"
    (tmp_path / "broken.stl").write_text("no mesh")
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_urdf(path)


BOX = '<box size="1 1 1"/>'


def arm(geometry: str = BOX, **settings: str) -> str:
    """Two links and the joint between them, which is changed by `settings` of `joint`."""
    return link("a", BOX) + link("b", geometry) + joint("a", "b", settings.pop("kind", "revolute"), **settings)


LADDER = "".join(link(f"l{i}") for i in range(31)) + "".join(
    joint(f"l{i}", f"l{i + 1}", "revolute").replace("_joint", f"_{k}") for i in range(30) for k in (0, 1)
)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (LADDER, "'l1' is carried by two joints"),
        (arm(more='<mimic joint="b_joint"/>'), "mimics itself"),
        (arm(more='<mimic joint="c_joint"/>') + link("c")
         + joint("a", "c", "revolute", more='<mimic joint="b_joint"/>'), "mimics itself"),
        (arm(more='<mimic joint="nobody"/>'), "does not exist"),
        (arm(more='<mimic joint="b_joint" offset="nan"/>'), "offset"),
        (link("r") + arm() + joint("b", "a", "revolute"), "carries itself"),
        (arm().replace('<child link="b"/>', '<child link="z"/>'), "'z' that does not exist"),
        (arm().replace('<child link="b"/>', ""), "names no child link"),
        (arm().replace('type="revolute"', ""), "has the type None"),
        (arm() + link("a"), "two links have one name"),
        (arm() + link(""), "printable"),
        (arm(axis="0 0 0"), "without direction"),
        (arm(axis="nan 0 1"), "xyz"),
        (arm(axis="1 0"), "3 finite numbers"),
        (arm(xyz="0 0 0 0"), "3 finite numbers"),
        (arm(limit="1 -1"), "wrong way round"),
        (arm(limit="-1 nan"), "upper"),
        (arm(limit="-1 1e300"), "upper"),
        (arm('<box size="-1 1 1"/>'), "negative"),
        (arm('<box size="1 1"/>'), "3 finite numbers"),
        (arm('<sphere radius="1e300"/>'), "radius"),
        (arm("<sphere/>"), "radius"),
        (arm("<capsule/>"), "'capsule'"),
        (arm("<mesh/>"), "without filename"),
        (arm('<mesh filename="cube.stl" scale="0 1 1"/>'), "scale"),
        (arm('<mesh filename="../../outside.stl"/>'), "not found"),
        (arm('<mesh filename="package://../outside.stl"/>'), "names no package"),
        (arm('<mesh filename="package://robot/../../outside.stl"/>'), "not found"),
        (arm('<mesh filename="http://localhost/cube.stl"/>'), "only package"),
        (arm(f'<mesh filename="{"x" * 5000}.stl"/>'), "not found"),
        ("<link>" * 90 + "</link>" * 90, "nested"),
    ],
)  # fmt: skip
def test_a_robot_that_is_none_is_told_before_anything_is_built(tmp_path, capfd, body, message):
    home = tmp_path / "package" / "robot"
    home.mkdir(parents=True)
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "outside.stl")
    with pytest.raises(InputError, match=message) as caught:
        load_urdf(write(home, body))
    assert "\n" not in str(caught.value) and str(home / "robot.urdf") in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_entities_are_not_read(tmp_path):
    (tmp_path / "secret").write_text("secret")
    doctype = f'<!DOCTYPE r [<!ENTITY x SYSTEM "{(tmp_path / "secret").as_uri()}">]>'
    (tmp_path / "robot.urdf").write_text(f'{doctype}<robot name="&x;">{arm()}</robot>')
    with pytest.raises(InputError, match="DOCTYPE"):
        load_urdf(tmp_path / "robot.urdf")


def test_meshes_beside_the_folder_of_the_urdf_are_found(tmp_path):
    for folder in ("package/urdf", "package/meshes"):
        (tmp_path / folder).mkdir(parents=True)
    cube = tmp_path / "package/meshes/cube.stl"
    trimesh.creation.box((1, 1, 1)).export(cube)
    for name in ("../meshes/cube.stl", cube.as_uri(), "package://package/meshes/cube.stl"):
        path = write(tmp_path / "package/urdf", arm(f'<mesh filename="{name}"/>'))
        assert areas(load_urdf(path).surfaces[1]).sum() == pytest.approx(6)
    deep = write(tmp_path / "package/urdf", arm('<mesh filename="../../other/cube.stl"/>'))
    (tmp_path / "other").mkdir()
    cube.rename(tmp_path / "other/cube.stl")
    with pytest.raises(InputError, match="not found"):
        load_urdf(deep)
    assert load_urdf(deep, package_dirs=[tmp_path / "other"]).n_parts == 2


def test_a_missing_parser_is_named(robot, monkeypatch):
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    with pytest.raises(InputError, match=r"rearticulate\[simulate\]"):
        simulate(robot)
