"""glTF 2.0, binary: a node a link, and the recorded sequence as an animation
(https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl
from numpy.typing import NDArray

from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.geometry.se3 import quat_wxyz

Array = NDArray[np.floating]

Y_UP = np.array([0.0, 1.0, 0.0])  # glTF's
WORLD = "world"


class _Buffer:
    """Arrays in one binary block."""

    def __init__(self, asset: gl.GLTF2) -> None:
        self.asset, self.data = asset, bytearray()

    def add(self, array: NDArray[Any], kind: str, target: int | None = None, bounds: bool = False) -> int:
        """Number of a new accessor for rows of float32 or uint32."""
        integer = np.issubdtype(array.dtype, np.integer)
        rows = np.ascontiguousarray(array, dtype="<u4" if integer else "<f4")
        view = gl.BufferView(buffer=0, byteOffset=len(self.data), byteLength=rows.nbytes, target=target)
        self.data += rows.tobytes()
        self.asset.bufferViews.append(view)
        accessor = gl.Accessor(
            bufferView=len(self.asset.bufferViews) - 1,
            componentType=gl.UNSIGNED_INT if integer else gl.FLOAT,
            count=rows.size if kind == gl.SCALAR else len(rows),
            type=kind,
        )
        if bounds:
            table = rows.reshape(accessor.count, -1)
            accessor.min, accessor.max = table.min(axis=0).tolist(), table.max(axis=0).tolist()
        self.asset.accessors.append(accessor)
        return len(self.asset.accessors) - 1


def write_gltf(path: Path, robot: Robot, config: ExportConfig) -> None:
    """One .glb. Node 0 turns the world so that up is up; its extras and those of the joints' nodes tell the joints."""
    asset = gl.GLTF2(asset=gl.Asset(version="2.0", generator="rearticulate"), scene=0, scenes=[gl.Scene(nodes=[0])])
    buffer = _Buffer(asset)
    n = len(robot.links)
    turn = quat_wxyz(_turn(config.up_axis, Y_UP))
    asset.nodes.append(gl.Node(name=WORLD, children=[1], rotation=_xyzw(turn)))
    for j, link in enumerate(robot.links):
        node = gl.Node(name=link.name, children=[k + 1 for k in robot.children(j)])
        node.translation = _offset(robot, j).tolist()
        node.extras = _joint(robot, j)
        if link.body is not None:
            node.mesh = _mesh(asset, buffer, robot, j)
        asset.nodes.append(node)
    if len(robot.q) > 1:
        asset.animations.append(_animation(buffer, robot, config))
    asset.buffers.append(gl.Buffer(byteLength=len(buffer.data)))
    asset.set_binary_blob(bytes(buffer.data))
    assert len(asset.nodes) == n + 1
    asset.save_binary(path)


def _mesh(asset: gl.GLTF2, buffer: _Buffer, robot: Robot, j: int) -> int:
    link = robot.links[j]
    body = link.body
    assert body is not None
    surface = body.surface
    faces = buffer.add(surface.faces.reshape(-1).astype(np.uint32), gl.SCALAR, gl.ELEMENT_ARRAY_BUFFER)
    attributes = gl.Attributes(
        POSITION=buffer.add(surface.vertices, gl.VEC3, gl.ARRAY_BUFFER, bounds=True),
        NORMAL=buffer.add(_unit(surface.vertex_normals), gl.VEC3, gl.ARRAY_BUFFER),
    )
    linear = (link.color / 255.0) ** 2.2
    asset.materials.append(
        gl.Material(
            name=f"{link.name}_color",
            pbrMetallicRoughness=gl.PbrMetallicRoughness(
                baseColorFactor=[*linear.tolist(), 1.0], metallicFactor=0.0, roughnessFactor=0.7
            ),
        )
    )
    primitive = gl.Primitive(attributes=attributes, indices=faces, material=len(asset.materials) - 1)
    asset.meshes.append(gl.Mesh(name=link.name, primitives=[primitive]))
    return len(asset.meshes) - 1


def _animation(buffer: _Buffer, robot: Robot, config: ExportConfig) -> gl.Animation:
    """Translation and rotation of every node that moves, a key a frame."""
    times = buffer.add(np.arange(len(robot.q)) / config.frames_per_second, gl.SCALAR, bounds=True)
    animation = gl.Animation(name="recorded")
    T = robot.forward(robot.q, robot.T_world_root)  # (F, L, 4, 4)
    for j, link in enumerate(robot.links):
        above = np.linalg.inv(T[:, link.parent]) if j else np.eye(4)
        local = above @ T[:, j]
        if j and link.kind == "fixed":
            continue
        quat = np.array([_xyzw(quat_wxyz(R)) for R in local[:, :3, :3]])
        for path, rows, kind in (("translation", local[:, :3, 3], gl.VEC3), ("rotation", _short_way(quat), gl.VEC4)):
            sampler = gl.AnimationSampler(input=times, output=buffer.add(rows, kind), interpolation="LINEAR")
            animation.samplers.append(sampler)
            target = gl.AnimationChannelTarget(node=j + 1, path=path)
            animation.channels.append(gl.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))
    return animation


def _joint(robot: Robot, j: int) -> dict[str, object]:
    """What glTF itself cannot say."""
    link = robot.links[j]
    if j == 0:
        return {}
    return {"joint": link.kind, "axis": link.axis.tolist(), "limits": list(link.limits)}


def _offset(robot: Robot, j: int) -> Array:
    return robot.links[j].origin - (robot.links[robot.links[j].parent].origin if j else 0.0)


def _unit(normals: Array) -> Array:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-12), Y_UP)


def _xyzw(quat: Array) -> list[float]:
    return [*quat[1:].tolist(), float(quat[0])]


def _short_way(quat: Array) -> Array:
    """Signs such that neighbours are on one side (q and -q are one rotation)."""
    sign = np.where((quat[1:] * quat[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    return quat * np.cumprod([1.0, *sign])[:, None]


def _turn(a: Array, b: Array) -> Array:
    """(3, 3) the smallest rotation from direction a to direction b."""
    from scipy.spatial.transform import Rotation

    return Rotation.align_vectors(b[None], a[None])[0].as_matrix()
