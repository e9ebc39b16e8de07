"""Any URDF as an articulated object: visual surfaces, moving joints; what does not move or is tiny is merged."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from rearticulate.errors import InputError, one_line
from rearticulate.extras import needs
from rearticulate.geometry.se3 import exp_se3
from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.meshes import find_mesh, load_triangles
from rearticulate.synth.surfaces import areas, moved
from rearticulate.synth.urdf_check import check_urdf

Array = NDArray[np.floating]
Folders = Sequence[str | os.PathLike[str]]

MOST_TRIANGLES = 20_000_000
_KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}


def load_urdf(
    path: str | os.PathLike[str], *, package_dirs: Folders = (), merge_below: float = 0.015
) -> ArticulatedObject:
    """Read a URDF as an ArticulatedObject; its parts are named after the links that carry them.

    package_dirs: folders that hold the packages of `package://` file names; the folders above the URDF are tried too.
    merge_below:  a part with at most this share of the whole visual surface is merged with its parent (the root with
                  its largest child), smallest first, as if the joint between them were fixed. At 0 only parts without
                  any surface are merged.
    Joints that cannot move (fixed, floating, planar, or without a range) stand still at their value nearest to 0.
    """
    path = Path(path)
    links = _in_order(_parse(path))
    folders = [Path(folder) for folder in package_dirs]
    surface = _surfaces(links, path, folders)
    moving = _merge(links, {name: float(areas(s).sum()) for name, s in surface.items()}, merge_below, path)
    return _assemble(links, surface, moving)


@dataclass(frozen=True)
class _Link:
    """A link and the joint that carries it (absent at the root)."""

    name: str
    visual: Any
    parent: str = ""
    kind: str = ""
    origin: Array | None = None
    axis: Array | None = None
    limits: tuple[float, float] = (0.0, 0.0)
    mimic: tuple[str, float, float] | None = None  # leading link, gear, offset

    @property
    def can_move(self) -> bool:
        has_axis = self.axis is not None and bool(self.axis.any())
        return self.kind in _KINDS and has_axis and self.limits[0] < self.limits[1]

    @property
    def held_motion(self) -> Array:
        """(4, 4) the joint's motion when it is held still at its value nearest to 0."""
        q = float(np.clip(0.0, *self.limits))
        if q == 0 or self.axis is None or self.kind not in _KINDS:
            return np.eye(4)
        direction = q * self.axis / np.linalg.norm(self.axis)
        zero = np.zeros(3)
        return exp_se3(np.concatenate([zero, direction] if self.kind == "prismatic" else [direction, zero]))


def _parse(path: Path) -> Any:
    with needs("simulate"):
        import yourdfpy
    check_urdf(path)
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # it says twice what an exception says once
    try:
        return yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:  # the parser fails in as many ways as there are broken files
        raise InputError(f"{path}: not a URDF that can be read ({one_line(error)})") from error


def _in_order(robot: Any) -> list[_Link]:
    """All links of the tree, depth first."""
    joints = {joint.name: joint for joint in robot.joints}
    visuals = {link.name: link.visuals for link in robot.links}
    carried: dict[str, list[Any]] = {name: [] for name in visuals}
    for joint in robot.joints:
        carried[joint.parent].append(joint)
    root = next(iter(visuals.keys() - {joint.child for joint in robot.joints}))
    order: list[_Link] = []
    stack = [_Link(root, visuals[root])]
    while stack:
        link = stack.pop()
        order.append(link)
        stack += [_link(joint, visuals[joint.child], joints) for joint in reversed(carried[link.name])]
    return order


def _link(joint: Any, visuals: Any, joints: dict[str, Any]) -> _Link:
    leader, gear, offset = joint, 1.0, 0.0
    while leader.mimic is not None:
        offset += gear * leader.mimic.offset
        gear *= leader.mimic.multiplier
        leader = joints[leader.mimic.joint]
    return _Link(
        name=joint.child,
        visual=visuals,
        parent=joint.parent,
        kind=joint.type,
        origin=np.eye(4) if joint.origin is None else joint.origin,
        axis=np.array([1.0, 0, 0]) if joint.axis is None else joint.axis,
        limits=_limits(joint),
        mimic=None if leader is joint else (leader.child, gear, offset),
    )


def _limits(joint: Any) -> tuple[float, float]:
    if joint.type == "continuous":
        return -np.inf, np.inf
    if joint.limit is None:
        return 0.0, 0.0
    return joint.limit.lower or 0.0, joint.limit.upper or 0.0


def _surfaces(links: list[_Link], path: Path, folders: list[Path]) -> dict[str, Array]:
    """`_link_surface` of all links, by name."""
    surface, count = {}, 0
    for link in links:
        surface[link.name] = _link_surface(link.visual, path, folders)
        count += len(surface[link.name])
        if count > MOST_TRIANGLES:
            raise InputError(f"{path}: its meshes have more than {MOST_TRIANGLES} triangles in all; simplify them")
    return surface


def _link_surface(visuals: Any, path: Path, folders: list[Path]) -> Array:
    """(T, 3, 3) triangles of all visual geometry of a link, in link coordinates."""
    parts: list[Array] = [np.zeros((0, 3, 3))]
    for visual in visuals:
        triangles = _geometry(visual.geometry, path, folders)
        parts.append(triangles if visual.origin is None else moved(visual.origin, triangles))
    return np.concatenate(parts)


def _geometry(geometry: Any, path: Path, folders: list[Path]) -> Array:
    if geometry.box is not None:
        solid = trimesh.creation.box(geometry.box.size)
    elif geometry.cylinder is not None:
        solid = trimesh.creation.cylinder(geometry.cylinder.radius, geometry.cylinder.length, sections=64)
    elif geometry.sphere is not None:
        solid = trimesh.creation.icosphere(subdivisions=4, radius=geometry.sphere.radius)
    else:
        triangles = load_triangles(find_mesh(geometry.mesh.filename, path, folders))
        return triangles if geometry.mesh.scale is None else triangles * geometry.mesh.scale
    return np.asarray(solid.triangles)


def _merge(links: list[_Link], area: dict[str, float], merge_below: float, path: Path) -> set[str]:
    """Names of the links whose joint moves, after merging what is too small."""
    total = sum(area.values())
    if total == 0:
        raise InputError(f"{path}: no visual geometry, there is nothing to sample")
    moving = {link.name for link in links if link.can_move}
    while moving:
        bodies = _bodies(links, moving)
        own = dict.fromkeys(bodies.values(), 0.0)
        for name, body in bodies.items():
            own[body] += area[name]
        smallest = min(sorted(own), key=lambda body: own[body])
        if own[smallest] > merge_below * total:
            break
        root = links[0].name
        children = [link.name for link in links if link.name in moving and bodies[link.parent] == root]
        moving.remove(max(children, key=lambda body: own[body]) if smallest == root else smallest)
    return moving


def _bodies(links: list[_Link], moving: set[str]) -> dict[str, str]:
    """The link that carries each link rigidly: the nearest one upwards whose joint moves, or the root."""
    bodies: dict[str, str] = {}
    for link in links:
        bodies[link.name] = link.name if link.name in moving or not link.parent else bodies[link.parent]
    return bodies


def _assemble(links: list[_Link], surface: dict[str, Array], moving: set[str]) -> ArticulatedObject:
    """One part a body, in coordinates of the posture in which every moving joint is at 0."""
    bodies, T_world = _bodies(links, moving), _rest_poses(links, moving)
    part = {name: p for p, name in enumerate(dict.fromkeys(bodies.values()))}
    by_name = {link.name: link for link in links}
    build: ObjectBuilder | None = None
    for name in part:
        here = [moved(T_world[member], surface[member]) for member, body in bodies.items() if body == name]
        link, triangles = by_name[name], np.concatenate(here)
        if build is None:
            build = ObjectBuilder(name, triangles)
            continue
        assert link.axis is not None
        follows = link.mimic is not None and link.mimic[0] in moving
        build.add(
            name,
            triangles,
            part[bodies[link.parent]],
            _KINDS[link.kind],
            axis=T_world[name][:3, :3] @ link.axis,
            point=T_world[name][:3, 3],
            limits=link.limits,
            mimic=(part[link.mimic[0]], *link.mimic[1:]) if follows and link.mimic else None,
        )
    assert build is not None
    return build.build()


def _rest_poses(links: list[_Link], moving: set[str]) -> dict[str, Array]:
    """T_world_link (4, 4) of every link: moving joints at 0, the others held."""
    T: dict[str, Array] = {links[0].name: np.eye(4)}
    for link in links[1:]:
        assert link.origin is not None
        T[link.name] = T[link.parent] @ link.origin @ (np.eye(4) if link.name in moving else link.held_motion)
    return T
