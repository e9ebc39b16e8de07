"""MJCF, the native format of MuJoCo: bodies, position actuators, a site on every joint axis, the frames as keyframes
(https://mujoco.readthedocs.io/en/stable/XMLreference.html)."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from rearticulate.export.drives import DAMPING_RATIO, GRAVITY, armature, damping, friction, stiffness
from rearticulate.export.meshes import collision_file, visual_file
from rearticulate.export.names import joint_name
from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.export.urdf import numbers
from rearticulate.geometry.se3 import quat_wxyz
from rearticulate.shape.body import Body

Array = NDArray[np.floating]

SITE = 0.06  # half length of the site on an axis, of the object's size
MJCF_TYPES = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}


def mjcf(robot: Robot, config: ExportConfig) -> str:
    """The text of the file. Meshes are named relative to it."""
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=numbers(-GRAVITY * config.up_axis), integrator="implicitfast")
    _defaults(root)
    assets = ET.SubElement(root, "asset")
    for link in robot.links:
        if link.body is not None:
            ET.SubElement(assets, "mesh", name=link.name, file=visual_file(link))
            for i in range(len(link.body.pieces)):
                ET.SubElement(assets, "mesh", name=f"{link.name}_collision_{i}", file=collision_file(link, i))
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos=numbers(10 * config.up_axis), dir=numbers(-config.up_axis), directional="true")
    _body(world, robot, config, 0, [], np.zeros(3))
    _actuators(root, robot)
    _keyframes(root, robot)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _defaults(root: ET.Element) -> None:
    defaults = ET.SubElement(root, "default")
    visual = ET.SubElement(defaults, "default", {"class": "visual"})
    ET.SubElement(visual, "geom", type="mesh", group="2", contype="0", conaffinity="0", density="0")
    collision = ET.SubElement(defaults, "default", {"class": "collision"})
    ET.SubElement(collision, "geom", type="mesh", group="3", density="0")


def _body(
    above: ET.Element, robot: Robot, config: ExportConfig, j: int, waiting: list[int], parent_origin: Array
) -> None:
    """Link j and all below it. waiting: links without a body above it, whose joints this body has, too."""
    link = robot.links[j]
    if link.body is None:
        for child in robot.children(j):
            _body(above, robot, config, child, [*waiting, j], parent_origin)
        return
    element = ET.SubElement(above, "body", name=link.name, pos=numbers(link.origin - parent_origin))
    if j == 0 and robot.floating:
        ET.SubElement(element, "freejoint", name="root")
    _inertial(element, link.body)
    for k in [*waiting, j]:
        if robot.links[k].kind != "fixed":
            _joint(element, robot, config, k)
    ET.SubElement(element, "geom", {"class": "visual"}, mesh=link.name, rgba=numbers([*link.color / 255.0, 1.0]))
    for i in range(len(link.body.pieces)):
        ET.SubElement(element, "geom", {"class": "collision"}, mesh=f"{link.name}_collision_{i}")
    for child in robot.children(j):
        _body(element, robot, config, child, [], link.origin)


def _inertial(element: ET.Element, body: Body) -> None:
    I = body.inertia
    full = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
    ET.SubElement(element, "inertial", pos=numbers(body.centre), mass=repr(body.mass), fullinertia=numbers(full))


def _joint(element: ET.Element, robot: Robot, config: ExportConfig, k: int) -> None:
    """A hinge or a slide through the origin of the link, and a site along it."""
    link = robot.links[k]
    attributes = {"name": joint_name(link.name), "type": MJCF_TYPES[link.kind], "axis": numbers(link.axis)}
    if link.kind != "continuous":
        attributes["range"] = numbers(link.limits)
    attributes["armature"] = repr(armature(robot, k))
    attributes["damping"] = repr(damping(robot, k, config))
    attributes["frictionloss"] = repr(friction(robot, k, config))
    ET.SubElement(element, "joint", attributes)
    half = SITE * robot.size
    ET.SubElement(
        element,
        "site",
        name=f"{link.name}_axis",
        type="cylinder",
        zaxis=numbers(link.axis),
        size=numbers([0.05 * half, half]),
        group="4",
    )


def _actuators(root: ET.Element, robot: Robot) -> None:
    """A servo a joint."""
    actuators = ET.SubElement(root, "actuator")
    for k in robot.joints_depth_first:
        link = robot.links[k]
        attributes = {"name": f"{link.name}_servo", "joint": joint_name(link.name)}
        attributes["ctrlrange"] = numbers([-np.pi, np.pi] if link.kind == "continuous" else link.limits)
        ET.SubElement(actuators, "position", attributes, kp=repr(stiffness(robot, k)), dampratio=repr(DAMPING_RATIO))


def _keyframes(root: ET.Element, robot: Robot) -> None:
    """The recorded frames: key frame_3 is the posture of frame 3. MuJoCo numbers joints as they come in the file."""
    keyframes = ET.SubElement(root, "keyframe")
    for f, (q, T) in enumerate(zip(robot.q, robot.T_world_root, strict=True)):
        base = [*T[:3, 3], *quat_wxyz(T[:3, :3])] if robot.floating else []
        ET.SubElement(keyframes, "key", name=f"frame_{f}", qpos=numbers([*base, *q[robot.joints_depth_first]]))
