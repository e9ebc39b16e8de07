"""URDF: links with meshes and inertias, joints with limits (http://wiki.ros.org/urdf/XML)."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from rearticulate.export.drives import damping, friction
from rearticulate.export.meshes import collision_file, visual_file
from rearticulate.export.names import joint_name
from rearticulate.export.robot import ExportConfig, Link, Robot
from rearticulate.shape.body import Body

Array = NDArray[np.floating]

WORLD = "world"
SMALL_MASS = 1e-3  # kg, of the links inside a ball joint
SMALL_INERTIA = 1e-6  # kg m^2


def urdf(robot: Robot, config: ExportConfig) -> str:
    """The text of the file. Meshes are named relative to it."""
    root = ET.Element("robot", name=robot.name)
    extension = ET.SubElement(root, "mujoco")  # other parsers skip it
    ET.SubElement(
        extension, "compiler", strippath="false", discardvisual="false", fusestatic="false", balanceinertia="true"
    )
    for link in robot.links:
        root.append(_link(link))
    if robot.floating:
        ET.SubElement(root, "link", name=WORLD)
        joint = ET.SubElement(root, "joint", name=f"{WORLD}_joint", type="floating")
        ET.SubElement(joint, "parent", link=WORLD)
        ET.SubElement(joint, "child", link=robot.links[0].name)
    for j in range(1, len(robot.links)):
        root.append(_joint(robot, j, config))
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _link(link: Link) -> ET.Element:
    element = ET.Element("link", name=link.name)
    _inertial(element, link.body)
    if link.body is None:
        return element
    visual = ET.SubElement(element, "visual")
    ET.SubElement(ET.SubElement(visual, "geometry"), "mesh", filename=visual_file(link))
    material = ET.SubElement(visual, "material", name=f"{link.name}_color")
    ET.SubElement(material, "color", rgba=numbers([*link.color / 255.0, 1.0]))
    for i in range(len(link.body.pieces)):
        geometry = ET.SubElement(ET.SubElement(element, "collision"), "geometry")
        ET.SubElement(geometry, "mesh", filename=collision_file(link, i))
    return element


def _inertial(element: ET.Element, body: Body | None) -> None:
    mass, centre, inertia = (
        (SMALL_MASS, np.zeros(3), SMALL_INERTIA * np.eye(3)) if body is None else (body.mass, body.centre, body.inertia)
    )
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(centre))
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {name: repr(float(inertia[at])) for name, at in pairs.items()})


def _joint(robot: Robot, j: int, config: ExportConfig) -> ET.Element:
    link, parent = robot.links[j], robot.links[robot.links[j].parent]
    joint = ET.Element("joint", name=joint_name(link.name), type=link.kind)
    ET.SubElement(joint, "origin", xyz=numbers(link.origin - parent.origin))
    ET.SubElement(joint, "parent", link=parent.name)
    ET.SubElement(joint, "child", link=link.name)
    if link.kind == "fixed":
        return joint
    ET.SubElement(joint, "axis", xyz=numbers(link.axis))
    limit = {"effort": repr(config.effort), "velocity": repr(config.velocity)}
    if link.kind != "continuous":
        limit |= {"lower": repr(link.limits[0]), "upper": repr(link.limits[1])}
    ET.SubElement(joint, "limit", limit)
    resists = {"damping": repr(damping(robot, j, config)), "friction": repr(friction(robot, j, config))}
    ET.SubElement(joint, "dynamics", resists)
    return joint


def numbers(values: Iterable[float]) -> str:
    """Numbers that read back exactly."""
    return " ".join(repr(float(x)) for x in values)
