"""One good file of every kind that is read, and how it is read."""

from __future__ import annotations

import dataclasses
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pypcd4 import Encoding
from pypcd4.pypcd4 import PointCloud

from mutations import Rng, bad_arrays, bad_bytes, bad_json, bad_words
from rearticulate.config import FitConfig, load_config
from rearticulate.io.clicks import load_clicks
from rearticulate.io.model import load_model, load_result, load_sequence_of, save_result
from rearticulate.io.posture import load_posture, save_posture
from rearticulate.io.sequence import load_scans, load_sequence
from rearticulate.io.truth import load_truth, save_truth
from rearticulate.records import FitResult, GroundTruth, KinematicModel, PointSequence
from rearticulate.synth.urdf import load_urdf
from toy_result import toy, toy_truth

POINTS = 60  # a part of the toy
URDF = """<?xml version="1.0"?>
<robot name="r">
<link name="base"><visual><origin xyz="0 0 0" rpy="0 0 0"/><geometry><box size="1 0.5 0.2"/></geometry></visual></link>
<link name="arm">
<visual><origin xyz="0.4 0 0"/><geometry><cylinder radius="0.1" length="0.8"/></geometry></visual>
</link>
<link name="tip"><visual><geometry><mesh filename="mesh.stl" scale="0.1 0.1 0.1"/></geometry></visual></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0.5 0 0" rpy="0 0 0.1"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="arm"/><child link="tip"/><origin xyz="0.8 0 0"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.3" effort="1" velocity="1"/><mimic joint="j1" multiplier="0.1"/></joint>
</robot>
"""


@dataclass(frozen=True)
class Kind:
    """content: of the good file. edits: what may be done to it. read(path): reads it and asserts what it means."""

    name: str
    content: bytes
    edits: tuple[Callable[[bytes, Rng], bytes], ...]
    read: Callable[[Path], Any]


def kinds(folder: Path) -> dict[str, Kind]:
    """All of them, by name. folder: for what they need beside them."""
    result, sequence = toy(POINTS)
    save_result(folder / "result", result, sequence)
    cloud = sequence.points[0]
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.export(folder / "mesh.stl")
    save_truth(folder / "toy.truth.npz", toy_truth())
    save_posture(folder / "posture.json", result.model, result.motion.posture(2))
    clicks = {"clicks": [{"source": [0.1, 0.2, 0.3], "target": [0.1, 0.4, 0.3], "part": "arm"}]}
    frames = np.stack(sequence.points).astype(np.float32)
    found = [
        Kind("seq.npz", packed({"points": frames}), (edited_arrays, bad_bytes), read_sequence),
        Kind(
            "ragged.npz", packed({f"f{f}": x for f, x in enumerate(frames)}), (edited_arrays, bad_bytes), read_sequence
        ),
        Kind("seq.npy", packed_array(frames), (bad_bytes,), read_sequence),
        Kind("scan.npy", packed_array(cloud), (bad_bytes,), read_scan),
        *(Kind(name, body, (edited_head, bad_bytes), read_scan) for name, body in clouds(cloud, folder).items()),
        *(Kind(name, body, (edited_text, bad_bytes), read_scan) for name, body in tables(cloud).items()),
        *(Kind(name, body, (edited_head, bad_bytes), read_scan) for name, body in meshes(mesh).items()),
        Kind("toy.truth.npz", (folder / "toy.truth.npz").read_bytes(), (edited_arrays, bad_bytes), read_truth),
        Kind("clicks.json", json.dumps(clicks).encode(), (edited_json, edited_text, bad_bytes), load_clicks),
        Kind("posture.json", (folder / "posture.json").read_bytes(), (edited_json, bad_bytes), Postures(result.model)),
        Kind(
            "config.json", json.dumps(dataclasses.asdict(FitConfig())).encode(), (edited_json, bad_bytes), read_config
        ),
        Kind("robot.urdf", URDF.encode(), (edited_text, bad_bytes), load_urdf),
        Kind("model.json", (folder / "result" / "model.json").read_bytes(), (edited_json, bad_bytes), read_result),
        Kind("arrays.npz", (folder / "result" / "arrays.npz").read_bytes(), (edited_arrays, bad_bytes), read_result),
    ]
    return {kind.name: kind for kind in found}


def clouds(cloud: np.ndarray, folder: Path) -> dict[str, bytes]:
    """PLY and PCD in all their encodings."""
    out = {}
    head = "ply\nformat {} 1.0\nelement vertex {}\n" + "".join(f"property float {a}\n" for a in "xyz") + "end_header\n"
    for order, name in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        out[f"{name}.ply"] = head.format(name, len(cloud)).encode() + cloud.astype(f"{order}f4").tobytes()
    rows = "".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in cloud)
    out["ascii.ply"] = (head.format("ascii", len(cloud)) + rows).encode()
    stored = PointCloud.from_xyz_points(cloud.astype(np.float32))
    for encoding in (Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED):
        path = folder / f"{encoding.value}.pcd"
        stored.save(path, encoding=encoding)
        out[path.name] = path.read_bytes()
    return out


def tables(cloud: np.ndarray) -> dict[str, bytes]:
    """Text in its three forms."""
    forms = {"scan.xyz": (" ", ""), "scan.txt": ("\t", "# x y z\n"), "scan.csv": (",", "x,y,z\n")}
    return {
        name: (head + "".join(between.join(f"{v:.6f}" for v in row) + "\n" for row in cloud)).encode()
        for name, (between, head) in forms.items()
    }


def meshes(mesh: trimesh.Trimesh) -> dict[str, bytes]:
    """A sphere in every mesh format."""
    out = {}
    for ending in ("ply", "obj", "stl", "off", "glb"):
        body: Any = mesh.export(file_type=ending)
        out[f"mesh.{ending}"] = body.encode() if isinstance(body, str) else body
    return out


def packed(arrays: dict[str, Any]) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def packed_array(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def edited_arrays(content: bytes, rng: Rng) -> bytes:
    with np.load(io.BytesIO(content)) as archive:
        return packed(bad_arrays(dict(archive), rng))


def edited_json(content: bytes, rng: Rng) -> bytes:
    return json.dumps(bad_json(json.loads(content), rng)).encode()


def edited_text(content: bytes, rng: Rng) -> bytes:
    return bad_words(content.decode("latin-1"), rng).encode("utf-8")


def edited_head(content: bytes, rng: Rng) -> bytes:
    """The words of a header, before binary data."""
    ends = [content.find(mark) for mark in (b"end_header", b"DATA")]
    head = max((end + 24 for end in ends if end >= 0), default=2000)
    return bad_words(content[:head].decode("latin-1"), rng).encode("latin-1", "replace") + content[head:]


def assert_sequence(sequence: PointSequence, finite: bool = True) -> None:
    for points, index in zip(sequence.points, sequence.index, strict=True):
        assert points.dtype == np.float64 and points.ndim == 2 and points.shape[1] == 3
        assert len(index) == len(points) and index.dtype.kind in "iu" and (not len(index) or index.min() >= 0)
        assert not finite or np.isfinite(points).all()


def read_sequence(path: Path) -> None:
    assert_sequence(load_sequence(path))


def read_scan(path: Path) -> None:
    assert_sequence(load_scans(path, mesh_samples=200))


def read_config(path: Path) -> None:
    load_config(path, FitConfig())


def read_truth(path: Path) -> None:
    assert_truth(load_truth(path))


def assert_truth(truth: GroundTruth) -> None:
    P = len(truth.parent)
    assert P and (truth.parent < 0).sum() == 1
    for j in range(P):
        seen = {j}
        while (j := int(truth.parent[j])) >= 0:
            assert j not in seen, "a cycle"
            seen.add(j)
    assert_rigid(truth.poses)
    assert_rigid(truth.novel)
    assert all(labels.min() >= 0 and labels.max() < P for labels in truth.labels if len(labels))


def assert_rigid(T: np.ndarray) -> None:
    assert T.dtype.kind == "f" and np.isfinite(T).all()
    R = T[..., :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-4)
    assert (np.linalg.det(R) > 0).all()
    np.testing.assert_allclose(T[..., 3, :], np.broadcast_to([0, 0, 0, 1.0], T[..., 3, :].shape))


@dataclass(frozen=True)
class Postures:
    """Reads postures of a model."""

    model: KinematicModel

    def __call__(self, path: Path) -> None:
        posture = load_posture(path, self.model)
        assert np.isfinite(posture.q).all()
        assert_rigid(posture.T_world_root)


def read_result(path: Path) -> None:
    """A result one of whose two files is `path`; the folder holds the other."""
    result, sequence = load_result(path.parent), load_sequence_of(path.parent)
    assert_model(load_model(path.parent))
    assert_model(result.model)
    assert_result(result, sequence)


def assert_model(model: KinematicModel) -> None:
    P = model.n_parts
    assert P and model.parent[0] == -1 and all(0 <= model.parent[j] < j for j in range(1, P))
    assert all(np.isfinite(x).all() for x in (model.axis, model.origin, model.limits, model.points))
    assert (model.limits[:, 0] <= model.limits[:, 1]).all()
    for j, kind in enumerate(model.joint_type):
        assert (kind == "floating") == (j == 0)
        if kind in ("revolute", "prismatic"):
            assert abs(np.linalg.norm(model.axis[j]) - 1) < 1e-3
    assert model.points.dtype.kind == "f" and len(model.points) == len(model.labels) > 0
    assert model.labels.dtype.kind in "iu" and model.labels.min() >= 0 and model.labels.max() < P
    assert len(set(model.names)) == P and all(name and name.isprintable() for name in model.names)


def assert_result(result: FitResult, sequence: PointSequence) -> None:
    F, P = len(result.labels), result.model.n_parts
    assert 0 <= result.model.canonical < F == len(sequence) == len(result.motion.q)
    assert result.motion.q.dtype.kind == "f" and np.isfinite(result.motion.q).all()
    assert_rigid(result.motion.T_world_root)
    assert_sequence(sequence)
    for labels, points in zip(result.labels, sequence.points, strict=True):
        assert len(labels) == len(points) and labels.dtype.kind in "iu"
        assert not len(labels) or (labels.min() >= 0 and labels.max() < P)
    assert result.residual.dtype.kind == "f" and isinstance(result.config, dict)
    assert all(isinstance(joint.determined, bool) and isinstance(joint.note, str) for joint in result.joints)
    assert len(result.joints) == P
