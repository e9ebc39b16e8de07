"""Meshes (OBJ, STL, OFF, GLB, PLY with faces): points drawn from their surface; without faces, their vertices.

What each format tells of its own length is compared with the file before it is read. An OBJ tells nothing: one that is
cut at the end of a line cannot be told from a whole one. Files beside the mesh (materials, textures, buffers) are not
opened.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rearticulate.io.budget import MAX_BYTES, check_held, check_promise, check_unpacked
from rearticulate.io.rows import Note, may_be_cut

_CUT = "last lines without a line end, which may be cut, dropped"
_GLB_SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_GLB_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def read_mesh(
    path: Path, samples: int, rng: np.random.Generator, note: Note, *, n_faces: int = 0, max_bytes: int = MAX_BYTES
) -> NDArray[Any]:
    """(N, 3) points: `samples` from the surface, area-weighted, or all vertices. n_faces: what the file promises.

    Raises ValueError where the file is not what it promises.
    """
    import trimesh

    kind = path.suffix.lower()
    data = _GATES.get(kind, _plain)(path, note, max_bytes)
    geometry = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], process=False).dump()
    meshes = [g for g in geometry if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    check_held(n_faces, sum(len(mesh.faces) for mesh in meshes), "faces")
    mesh: Any = trimesh.util.concatenate(meshes) if meshes else None
    if mesh is None or not mesh.area > 0:
        clouds: list[Any] = [g for g in geometry if hasattr(g, "vertices")]
        if not any(len(cloud.vertices) for cloud in clouds):
            raise ValueError("it holds no points")
        return np.concatenate([np.asarray(cloud.vertices) for cloud in clouds])
    return np.asarray(trimesh.sample.sample_surface(mesh, samples, seed=int(rng.integers(2**31)))[0])


def _plain(path: Path, note: Note, max_bytes: int) -> bytes:
    return path.read_bytes()


def _obj(path: Path, note: Note, max_bytes: int) -> bytes:
    data = path.read_bytes()
    if may_be_cut(path):
        note(_CUT, 1)
        data = data[: data.rindex(b"\n") + 1]
    return data


def _off(path: Path, note: Note, max_bytes: int) -> bytes:
    """OFF, its counts as they must be; a last face that may be cut is left out of both."""
    lines = [text for line in path.read_bytes().splitlines() if (text := line.partition(b"#")[0].strip())]
    head = lines[0].split() if lines else [b""]
    if head[0] not in (b"OFF", b"COFF"):
        raise ValueError("it does not start with OFF")
    counts, body = (head[1:], lines[1:]) if len(head) > 1 else (lines[1].split() if len(lines) > 1 else [], lines[2:])
    if len(counts) < 2 or not all(count.isdigit() for count in counts[:2]):
        raise ValueError("it does not say how many vertices and faces it has")
    n, n_faces = int(counts[0]), int(counts[1])
    check_promise(n + n_faces, len(body), "lines")
    if n_faces and may_be_cut(path):
        note(_CUT, 1)
        n_faces, body = n_faces - 1, body[:-1]
    return b"\n".join([head[0], b"%d %d 0" % (n, n_faces), *body, b""])


def _stl(path: Path, note: Note, max_bytes: int) -> bytes:
    data = path.read_bytes()
    is_text = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096]
    if is_text and data.count(b"endfacet") != data.count(b"endloop"):
        raise ValueError("cut off within a triangle")
    if is_text and b"endsolid" not in data[-1000:].lower():
        raise ValueError("cut off: it does not end with endsolid")
    return data


def _glb(path: Path, note: Note, max_bytes: int) -> bytes:
    """GLB whose chunks fill the file, whose arrays lie in its buffer, and whose nodes form trees."""
    data = path.read_bytes()
    if data[:4] != b"glTF" or len(data) < 20:
        raise ValueError("it does not start with glTF")
    check_promise(struct.unpack("<I", data[8:12])[0], len(data), "bytes")
    (n_json,) = struct.unpack("<I", data[12:16])
    tree = json.loads(data[20 : 20 + n_json])
    held = struct.unpack("<I", data[20 + n_json : 24 + n_json])[0] if len(data) >= 28 + n_json else 0
    held = min(held, len(data) - 28 - n_json)
    views = tree.get("bufferViews", [])
    for view in views:
        if view.get("buffer", 0) != 0 or view.get("byteOffset", 0) < 0 or view["byteLength"] < 0:
            raise ValueError("a part of its buffer lies outside of the file")
        check_held(view.get("byteOffset", 0) + view["byteLength"], held, "bytes")
    check_unpacked(str(path), sum(_accessor_bytes(a, views) for a in tree.get("accessors", [])), len(data), max_bytes)
    children = [child for node in tree.get("nodes", []) for child in node.get("children", [])]
    if len(set(children)) < len(children) or set(children) & _roots_of(tree):
        raise ValueError("its nodes form no tree")
    return data


def _roots_of(tree: dict[str, Any]) -> set[int]:
    return {root for scene in tree.get("scenes", []) for root in scene.get("nodes", [])}


def _accessor_bytes(accessor: dict[str, Any], views: list[dict[str, Any]]) -> int:
    n_bytes = accessor["count"] * _GLB_SIZES[accessor["componentType"]] * _GLB_NUMBERS[accessor["type"]]
    if "bufferView" in accessor:
        check_held(n_bytes, views[accessor["bufferView"]]["byteLength"], "bytes of an array")
    return n_bytes


_GATES: dict[str, Callable[[Path, Note, int], bytes]] = {".obj": _obj, ".off": _off, ".stl": _stl, ".glb": _glb}
