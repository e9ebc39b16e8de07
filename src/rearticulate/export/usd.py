"""USD with UsdPhysics: an articulation of rigid bodies and joints (https://openusd.org/release/api/usd_physics_page_front.html).

The recorded sequence is in the time samples of the bodies' transforms. As in the MJCF, joints have position drives.
"""

# pyright: reportAttributeAccessIssue=false
# (pxr comes without types)
from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rearticulate.export.drives import GRAVITY, armature, damping, friction, servo_damping, stiffness
from rearticulate.export.names import joint_name
from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.export.urdf import SMALL_INERTIA, SMALL_MASS
from rearticulate.geometry.se3 import quat_wxyz

Array = NDArray[np.floating]

FRICTION, ARMATURE = "newton:friction", "newton:armature"  # UsdPhysics itself has none
X = np.array([1.0, 0.0, 0.0])  # the axis of every joint in its own frame


def write_usd(path: Path, robot: Robot, config: ExportConfig) -> None:
    """One .usdc or .usda file, meshes included."""
    from pxr import Gf, Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y if config.up[-1] == "y" else UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(config.frames_per_second)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(robot.q) - 1)
    root = UsdGeom.Xform.Define(stage, f"/{robot.name}")
    stage.SetDefaultPrim(root.GetPrim())
    scene = UsdPhysics.Scene.Define(stage, f"/{robot.name}/physics")
    scene.CreateGravityDirectionAttr(Gf.Vec3f(*(-config.up_axis).tolist()))
    scene.CreateGravityMagnitudeAttr(GRAVITY)
    UsdPhysics.ArticulationRootAPI.Apply(root.GetPrim())
    _bodies(stage, robot)
    if not robot.floating:
        anchor = UsdPhysics.FixedJoint.Define(stage, f"/{robot.name}/joints/root_joint")
        anchor.CreateBody1Rel().SetTargets([_path(robot, 0)])
    for j in range(1, len(robot.links)):
        _joint(stage, robot, config, j)
    stage.GetRootLayer().Save()


def _path(robot: Robot, j: int) -> str:
    return f"/{robot.name}/{robot.links[j].name}"


def _bodies(stage, robot: Robot) -> None:
    """All links side by side, as UsdPhysics wants them, each with its pose in every frame."""
    from pxr import Gf, Usd, UsdGeom, UsdPhysics

    rest = robot.forward(np.zeros(len(robot.links)))
    T = robot.forward(robot.q, robot.T_world_root)
    for j, link in enumerate(robot.links):
        prim = UsdGeom.Xform.Define(stage, _path(robot, j))
        translate, orient = prim.AddTranslateOp(), prim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
        for time, pose in [(Usd.TimeCode.Default(), rest[j]), *((Usd.TimeCode(f), T[f, j]) for f in range(len(T)))]:
            translate.Set(Gf.Vec3d(*pose[:3, 3].tolist()), time)
            orient.Set(Gf.Quatd(*quat_wxyz(pose[:3, :3]).tolist()), time)
        UsdPhysics.RigidBodyAPI.Apply(prim.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(prim.GetPrim())
        body = link.body
        mass.CreateMassAttr(SMALL_MASS if body is None else body.mass)
        inertia = SMALL_INERTIA * np.eye(3) if body is None else body.inertia
        moments, axes = np.linalg.eigh(inertia)
        axes = axes * np.sign(np.linalg.det(axes))
        mass.CreateCenterOfMassAttr(Gf.Vec3f(*(np.zeros(3) if body is None else body.centre).tolist()))
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
        mass.CreatePrincipalAxesAttr(Gf.Quatf(*quat_wxyz(axes).tolist()))
        if body is None:
            continue
        surface = _mesh(stage, f"{_path(robot, j)}/visual", body.surface)
        surface.CreateDisplayColorAttr([Gf.Vec3f(*((link.color / 255.0) ** 2.2).tolist())])
        for i, piece in enumerate(body.pieces):
            hull = _mesh(stage, f"{_path(robot, j)}/collision_{i}", piece)
            hull.CreatePurposeAttr(UsdGeom.Tokens.guide)
            UsdPhysics.CollisionAPI.Apply(hull.GetPrim())
            UsdPhysics.MeshCollisionAPI.Apply(hull.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)


def _mesh(stage, path: str, mesh):
    from pxr import UsdGeom, Vt

    prim = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(np.asarray(mesh.vertices, dtype=np.float32))
    prim.CreatePointsAttr(points)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, dtype=np.int32)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.asarray(mesh.faces, dtype=np.int32).reshape(-1)))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    return prim


def _joint(stage, robot: Robot, config: ExportConfig, j: int) -> None:
    """Joint j: its frame on either body has x along the axis."""
    from pxr import Gf, Sdf, UsdPhysics

    link, path = robot.links[j], f"/{robot.name}/joints/{joint_name(robot.links[j].name)}"
    kinds = {
        "fixed": UsdPhysics.FixedJoint,
        "prismatic": UsdPhysics.PrismaticJoint,
        "revolute": UsdPhysics.RevoluteJoint,
        "continuous": UsdPhysics.RevoluteJoint,
    }
    joint = kinds[link.kind].Define(stage, path)
    joint.CreateBody0Rel().SetTargets([_path(robot, link.parent)])
    joint.CreateBody1Rel().SetTargets([_path(robot, j)])
    joint.CreateLocalPos0Attr(Gf.Vec3f(*(link.origin - robot.links[link.parent].origin).tolist()))
    joint.CreateLocalPos1Attr(Gf.Vec3f(0, 0, 0))
    if link.kind == "fixed":
        return
    turn = Gf.Quatf(*quat_wxyz(Rotation.align_vectors(link.axis[None], X[None])[0].as_matrix()).tolist())
    joint.CreateLocalRot0Attr(turn)
    joint.CreateLocalRot1Attr(turn)
    joint.CreateAxisAttr("X")
    if link.kind != "continuous":
        low, high = np.degrees(link.limits) if link.kind == "revolute" else link.limits
        joint.CreateLowerLimitAttr(float(low))
        joint.CreateUpperLimitAttr(float(high))
    linear = link.kind == "prismatic"
    kind = UsdPhysics.Tokens.linear if linear else UsdPhysics.Tokens.angular
    drive = UsdPhysics.DriveAPI.Apply(joint.GetPrim(), kind)
    per_unit = 1.0 if linear else np.pi / 180  # UsdPhysics counts turns in degrees
    drive.CreateTargetPositionAttr(0.0)
    drive.CreateStiffnessAttr(stiffness(robot, j) * per_unit)
    drive.CreateDampingAttr((servo_damping(robot, j) + damping(robot, j, config)) * per_unit)
    for name, value in ((FRICTION, friction(robot, j, config)), (ARMATURE, armature(robot, j))):
        joint.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(value)
