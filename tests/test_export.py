"""Every format, read back by the software it is for: the same kinematics, valid files, a simulation that runs."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdValidation
from scipy.spatial.transform import Rotation

from rearticulate.bench.dynamics import gate, passes
from rearticulate.bench.engines.in_mujoco import MujocoEngine
from rearticulate.bench.khronos import VALIDATOR, validate
from rearticulate.bench.referees import referees
from rearticulate.export.build import make_robot
from rearticulate.export.drives import damping, servo_damping, stiffness
from rearticulate.export.names import safe_names
from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.export.write import FORMATS, export
from rearticulate.geometry.se3 import exp_se3, inverse, transform
from rearticulate.posing.single import single_valued
from rearticulate.records import FitResult, Motion, PointSequence
from test_spherical import ball_model
from toy_result import branched, toy

TOLERANCE = 1e-5  # m
POSTURES = 100
ODD_NAMES = ("base", "arm & <1>", "Base")


def ball_result() -> tuple[FitResult, PointSequence]:
    """A chain of ball joints with a hinge, and its recording."""
    base, _ = toy()
    model = ball_model()
    q = 0.4 * np.random.default_rng(2).normal(size=(4, model.n_values))
    q[0], q[:, 0] = 0.0, 0.0
    root = np.array([exp_se3(0.2 * f * np.array([0, 0, 1.0, 1.0, 0, 0])) for f in range(4)])
    frames = [transform(T[model.labels], model.points) for T in model.forward(q, root)]
    result = replace(
        base, model=model, motion=Motion(q, root), labels=(model.labels,) * 4, joints=(base.joints[0],) * 4
    )
    return result, PointSequence.from_arrays(frames)


def everything(result: FitResult, sequence: PointSequence, folder: Path, config: ExportConfig) -> tuple[Robot, Path]:
    robot = make_robot(result, sequence, "my robot", config)
    export(robot, folder, FORMATS, config)
    return robot, folder


@pytest.fixture(scope="module", params=["screws", "balls", "floating", "branched"])
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, Path]:
    folder = tmp_path_factory.mktemp(request.param)
    make = {"balls": ball_result, "branched": branched}.get(request.param, lambda: toy(400, ODD_NAMES))
    return everything(*make(), folder, ExportConfig(floating=request.param == "floating", up="-y"))


def postures(robot: Robot, count: int = POSTURES) -> np.ndarray:
    """(count, L) random joint values within the limits."""
    rng = np.random.default_rng(0)
    q = np.zeros((count, len(robot.links)))
    for j in robot.joints:
        q[:, j] = rng.uniform(*robot.links[j].limits, count)
    return q


@pytest.mark.parametrize("make", [lambda: toy(200), ball_result], ids=["screws", "balls"])
def test_links_move_as_the_parts_of_the_model(make: Any) -> None:
    result, sequence = make()
    model, robot = result.model, make_robot(result, sequence, "x", ExportConfig())
    single = single_valued(model)
    T_links = robot.forward(robot.q, robot.T_world_root)
    T_parts = model.forward(result.motion.q, result.motion.T_world_root)
    for p, k in enumerate(single.number):
        at_rest = np.eye(4)
        at_rest[:3, 3] = robot.links[k].origin
        np.testing.assert_allclose(T_links[:, k], T_parts[:, p] @ at_rest, atol=1e-12)


def simulation(path: Path) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_path(str(path))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("suffix", ["urdf", "xml"])
def test_mujoco_moves_the_links_as_we_do(exported: tuple[Robot, Path], suffix: str) -> None:
    robot, folder = exported
    model, data = simulation(folder / f"{robot.name}.{suffix}")
    links = [j for j, link in enumerate(robot.links) if link.body is not None]
    bodies = [model.body(robot.links[j].name).id for j in links]
    address = [model.joint(f"{robot.links[j].name}_joint").qposadr[0] for j in robot.joints]
    for q, T in zip(postures(robot), robot.forward(postures(robot)), strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos[address] = q[robot.joints]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.xpos[bodies], T[links, :3, 3], atol=TOLERANCE)
        np.testing.assert_allclose(data.xmat[bodies].reshape(-1, 3, 3), T[links, :3, :3], atol=TOLERANCE)


def test_yourdfpy_moves_the_links_as_we_do(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    urdf = yourdfpy.URDF.load(str(folder / f"{robot.name}.urdf"))
    assert urdf.validate() and not urdf.errors
    order = {f"{robot.links[j].name}_joint": j for j in robot.joints}
    assert set(urdf.actuated_joint_names) - {"world_joint"} == set(order)
    for q, T in zip(postures(robot, 20), robot.forward(postures(robot, 20)), strict=True):
        urdf.update_cfg({name: q[j] for name, j in order.items()})
        for j, link in enumerate(robot.links):
            np.testing.assert_allclose(urdf.get_transform(link.name, robot.links[0].name), T[j], atol=TOLERANCE)


def test_mujoco_runs_two_thousand_steps_without_a_warning(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    model, data = simulation(folder / f"{robot.name}.xml")
    assert model.nu == len(robot.joints)
    np.testing.assert_allclose(model.opt.gravity, [0, 9.81, 0])
    rng = np.random.default_rng(0)
    for step in range(2000):
        if step % 100 == 0:
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_step(model, data)
    assert not any(warning.number for warning in data.warning)
    assert np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()


def test_servos_reach_what_they_are_told(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    model, data = simulation(folder / f"{robot.name}.xml")
    model.opt.gravity[:] = 0
    model.geom_contype[:] = 0
    wanted = 0.5 * model.actuator_ctrlrange[:, 1]
    data.ctrl[:] = wanted
    for _ in range(1500):
        mujoco.mj_step(model, data)
    address = model.jnt_qposadr[model.actuator_trnid[:, 0]]
    np.testing.assert_allclose(data.qpos[address], wanted, atol=5e-3)


def test_keyframes_are_the_recorded_frames(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    model, data = simulation(folder / f"{robot.name}.xml")
    assert model.nkey == len(robot.q)
    T = robot.forward(robot.q, robot.T_world_root if robot.floating else None)
    for f in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, f)
        mujoco.mj_kinematics(model, data)
        for j, link in enumerate(robot.links):
            if link.body is not None:
                np.testing.assert_allclose(data.body(link.name).xpos, T[f, j, :3, 3], atol=TOLERANCE)


def test_sites_lie_on_the_axes(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    model, data = simulation(folder / f"{robot.name}.xml")
    mujoco.mj_forward(model, data)
    for j in robot.joints:
        site = data.site(f"{robot.links[j].name}_axis")
        np.testing.assert_allclose(site.xpos, robot.links[j].origin, atol=TOLERANCE)
        np.testing.assert_allclose(site.xmat.reshape(3, 3)[:, 2], robot.links[j].axis, atol=1e-6)


def usd_forward(stage: Usd.Stage, q: dict[str, float]) -> dict[str, np.ndarray]:
    """Poses of the bodies from the frames of the joints, as UsdPhysics defines them."""
    poses: dict[str, np.ndarray] = {}
    joints = [UsdPhysics.Joint(prim) for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)]

    def frame(position: Any, rotation: Any) -> np.ndarray:
        T = np.eye(4)
        T[:3, 3] = position.Get()
        turn = rotation.Get() or Gf.Quatf(1)
        T[:3, :3] = Rotation.from_quat([*turn.GetImaginary(), turn.GetReal()]).as_matrix()
        return T

    for joint in joints:
        above, below = joint.GetBody0Rel().GetTargets(), joint.GetBody1Rel().GetTargets()
        if not above:
            poses[below[0].name] = np.eye(4)
            continue
        value = q.get(joint.GetPrim().GetName(), 0.0)
        twist = np.zeros(6)
        if joint.GetPrim().IsA(UsdPhysics.PrismaticJoint):
            twist[3] = value
        elif joint.GetPrim().IsA(UsdPhysics.RevoluteJoint):
            twist[0] = value
        frame0 = frame(joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr())
        frame1 = frame(joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr())
        start = poses.setdefault(above[0].name, np.eye(4))
        poses[below[0].name] = start @ frame0 @ exp_se3(twist) @ inverse(frame1)
    return poses


def test_usd_is_valid_and_its_joints_move_the_links_as_we_do(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    stage = Usd.Stage.Open(str(folder / f"{robot.name}.usdc"))
    registry = UsdValidation.ValidationRegistry()
    names = [found.name for found in registry.GetAllValidatorMetadata()]
    assert "usdPhysicsValidators:PhysicsJointChecker" in names
    errors = UsdValidation.ValidationContext(registry.GetOrLoadValidatorsByName(names)).Validate(stage)
    assert [error.GetMessage() for error in errors] == []
    for q, T in zip(postures(robot), robot.forward(postures(robot)), strict=True):
        poses = usd_forward(stage, {f"{link.name}_joint": q[j] for j, link in enumerate(robot.links)})
        for j, link in enumerate(robot.links):
            np.testing.assert_allclose(poses[link.name], T[j], atol=TOLERANCE)


def test_usd_plays_the_recording_and_knows_the_bodies(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    stage = Usd.Stage.Open(str(folder / f"{robot.name}.usdc"))
    T = robot.forward(robot.q, robot.T_world_root)
    for j, link in enumerate(robot.links):
        prim = stage.GetPrimAtPath(f"/{robot.name}/{link.name}")
        for f in range(len(T)):
            found = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(f)).T
            np.testing.assert_allclose(found, T[f, j], atol=TOLERANCE)
        if link.body is not None:
            assert UsdPhysics.MassAPI(prim).GetMassAttr().Get() == pytest.approx(link.body.mass, rel=1e-6)


def test_usd_drives_the_joints_and_leaves_no_pair_out(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    stage = Usd.Stage.Open(str(folder / f"{robot.name}.usdc"))
    for j in robot.joints:
        slides = robot.links[j].kind == "prismatic"
        prim = stage.GetPrimAtPath(f"/{robot.name}/joints/{robot.links[j].name}_joint")
        drive = UsdPhysics.DriveAPI(prim, "linear" if slides else "angular")
        unit = 1.0 if slides else np.degrees(1.0)
        assert drive.GetStiffnessAttr().Get() * unit == pytest.approx(stiffness(robot, j), rel=1e-6)
        assert drive.GetDampingAttr().Get() * unit == pytest.approx(
            servo_damping(robot, j) + damping(robot, j, ExportConfig()), rel=1e-6
        )
    assert not any(prim.HasAPI(UsdPhysics.FilteredPairsAPI) for prim in stage.Traverse())


def glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """The two blocks of a binary glTF."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def accessor(tree: dict[str, Any], block: bytes, number: int) -> np.ndarray:
    entry = tree["accessors"][number]
    view = tree["bufferViews"][entry["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[entry["type"]]
    kind = {5126: "<f4", 5125: "<u4"}[entry["componentType"]]
    return np.frombuffer(block, kind, entry["count"] * width, view.get("byteOffset", 0)).reshape(-1, width)


def test_gltf_plays_the_recording_with_up_up(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    tree, block = glb(folder / f"{robot.name}.glb")
    animation, nodes = tree["animations"][0], tree["nodes"]
    T = robot.forward(robot.q, robot.T_world_root)
    up = Rotation.from_quat(nodes[0]["rotation"])
    np.testing.assert_allclose(up.apply([0, -1, 0]), [0, 1, 0], atol=1e-6)
    parent = {child: n for n, node in enumerate(nodes) for child in node.get("children", [])}
    for f in range(len(T)):
        local = {}
        for n, node in enumerate(nodes):
            local[n] = np.eye(4)
            local[n][:3, 3] = node.get("translation") or np.zeros(3)
        for channel in animation["channels"]:
            value = accessor(tree, block, animation["samplers"][channel["sampler"]]["output"])[f]
            n, path = channel["target"]["node"], channel["target"]["path"]
            if path == "translation":
                local[n][:3, 3] = value
            else:
                local[n][:3, :3] = Rotation.from_quat(value).as_matrix()
        world = {0: np.eye(4)}
        for n in range(1, len(nodes)):
            world[n] = world[parent[n]] @ local[n]
        for j, link in enumerate(robot.links):
            n = next(n for n, node in enumerate(nodes) if node.get("name") == link.name)
            np.testing.assert_allclose(world[n], T[f, j], atol=TOLERANCE)


def test_gltf_tells_its_joints_and_other_software_reads_it(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    tree, _ = glb(folder / f"{robot.name}.glb")
    told = {node["name"]: node["extras"] for node in tree["nodes"] if node.get("extras")}
    for j in robot.joints:
        link = robot.links[j]
        assert told[link.name]["joint"] == link.kind
        np.testing.assert_allclose(told[link.name]["axis"], link.axis)
    scene = trimesh.load_scene(folder / f"{robot.name}.glb")
    assert len(scene.geometry) == sum(link.body is not None for link in robot.links)


def test_gltf_passes_the_khronos_validator(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    told = validate(folder / f"{robot.name}.glb")
    if told is None:
        pytest.skip(f"npm is not there or cannot install {VALIDATOR}")
    assert (told["numErrors"], told["numWarnings"]) == (0, 0), told["messages"]


def test_clouds_of_the_parts(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    files = sorted((folder / "parts").iterdir())
    assert len(files) == len(robot.clouds)
    assert sum(len(trimesh.load(file).vertices) for file in files) == sum(map(len, robot.clouds))


def test_an_export_rests_sweeps_and_holds(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    if robot.floating:
        pytest.skip("the gate is for a fixed root")
    for engine, measures in gate(robot, folder).items():
        assert passes(measures), (engine, measures)


def test_others_find_no_errors_in_a_description(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    if robot.floating:
        pytest.skip("simcheck takes the link `world`, to which the floating joint ties the robot, for a body")
    found = referees(folder / f"{robot.name}.urdf")
    assert {name: count for name, count in found.items() if name.endswith(".errors")} == dict.fromkeys(
        ("simcheck.errors", "urdf_validator.errors"), 0
    )


def test_links_that_meet_beyond_their_limits_do_touch(exported: tuple[Robot, Path]) -> None:
    robot, folder = exported
    assert simulation(folder / f"{robot.name}.xml")[0].nexclude == 0
    if robot.floating or "arm" not in {link.name.split("_")[0] for link in robot.links}:
        return
    engine = MujocoEngine(folder / f"{robot.name}.urdf")
    assert engine.contacts({f"{robot.links[1].name}_joint": np.pi})  # the arm folded into the base


def test_names_are_safe_and_all_different() -> None:
    assert safe_names(["base", "arm & <1>", "Base", "", "7", "base_2", "Ünïcode"]) == (
        "base",
        "arm_1",
        "Base_2",
        "part",
        "part_7",
        "base_2_2",
        "n_code",
    )


def test_limits_have_their_margin_and_full_turns_have_none() -> None:
    result, sequence = toy(100)
    robot = make_robot(result, sequence, "x", ExportConfig(margin=0.5))
    low, high = result.model.limits[1]
    np.testing.assert_allclose(robot.links[1].limits, [low - 0.5 * (high - low), high + 0.5 * (high - low)])
    q = result.motion.q.copy()
    q[:, 1] *= 12
    robot = make_robot(replace(result, motion=Motion(q, result.motion.T_world_root)), sequence, "x", ExportConfig())
    assert [link.kind for link in robot.links] == ["fixed", "continuous", "prismatic"]
