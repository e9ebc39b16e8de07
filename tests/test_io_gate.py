"""A header is a promise: it is held against the file and a byte budget before memory is taken for it."""

from __future__ import annotations

import json
import struct
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from clouds import clouds
from rearticulate.errors import InputError, InputWarning
from rearticulate.io import load_scans
from rearticulate.io.npz import load_arrays

POINTS = clouds(1)[0].astype("<f4")
XYZ = "property float x\nproperty float y\nproperty float z\n"


def refused(path: Path, **options: int) -> str:
    with pytest.raises(InputError) as caught:
        load_scans(path, **options)
    line = str(caught.value)
    assert "\n" not in line
    assert str(path) in line
    return line


def npy(shape: str, body: bytes = b"", descr: str = "<f4") -> bytes:
    head = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + body


def zipped(path: Path, packed: bool, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


@pytest.mark.parametrize("loader", [load_scans, load_arrays])
def test_a_small_archive_of_many_zeros_is_not_unpacked(loader: Callable[[Path], object], tmp_path: Path) -> None:
    n = 300_000_000
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("points.npy", npy(f"(1, {n // 12}, 3)", bytes(n)))
    with pytest.raises(InputError, match="unpack to 300 MB are no measured points"):
        loader(tmp_path / "a.npz")


def test_the_budget_is_an_option_and_counts_all_arrays(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points_0=POINTS, points_1=POINTS)
    assert len(load_scans(tmp_path / "a.npz", max_bytes=5000)) == 2
    assert "--max-bytes" in refused(tmp_path / "a.npz", max_bytes=3000)
    with pytest.raises(InputError, match="--max-bytes"):
        load_arrays(tmp_path / "a.npz", 3000)
    np.save(tmp_path / "a.npy", POINTS)
    assert "more than the 0.001 MB allowed" in refused(tmp_path / "a.npy", max_bytes=1000)


@pytest.mark.parametrize(
    ("shape", "complaint"),
    [
        ("(10, 1000000000000, 3)", "cut off: the header promises 120000000000128"),
        (f"({2**62}, {2**62})", "cut off"),
        ("(-1, 150, 3)", "a shape of"),
        ("(1, 149, 3)", "promises 1916 bytes"),
        ("(1, 151, 3)", "cut off"),
    ],
)
def test_array_headers_that_lie(shape: str, complaint: str, tmp_path: Path) -> None:
    body = npy(shape, POINTS.tobytes())
    assert complaint in refused(zipped(tmp_path / "a.npz", False, points=body))
    (tmp_path / "a.npy").write_bytes(body)
    assert complaint in refused(tmp_path / "a.npy")


def test_archives_with_two_meanings(tmp_path: Path) -> None:
    body = npy("(150, 3)", POINTS.tobytes())
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(2):
            archive.writestr("points.npy", body)
    assert "two arrays of one name" in refused(tmp_path / "a.npz")
    assert "10001 arrays" in refused(zipped(tmp_path / "b.npz", False, **{f"f{i}": b"" for i in range(10_001)}))
    np.savez(tmp_path / "c.npz", a_normals=POINTS, b_cloud=POINTS, c_cloud=POINTS)
    assert "several kinds of arrays could be the frames (a_normals, b_cloud" in refused(tmp_path / "c.npz")
    np.savez(tmp_path / "d.npz", frame_0=POINTS, frame_1=POINTS, normals_0=POINTS, normals_1=POINTS)
    assert "(frame_0, normals_0); call the frames points_000" in refused(tmp_path / "d.npz")
    np.savez(tmp_path / "e.npz", **{"x\ny": POINTS})
    assert "cannot be printed" in refused(tmp_path / "e.npz")


def test_archives_with_one_meaning(tmp_path: Path) -> None:
    first, second = POINTS, POINTS + 1
    for arrays in (
        {"points_0": first, "points_1": second, "normals_0": first, "normals_1": first},
        {"frame_0": first, "frame_1": second, "times": np.arange(2.0)},
    ):
        np.savez(tmp_path / "a.npz", **arrays)
        np.testing.assert_array_equal(load_scans(tmp_path / "a.npz").points, [first, second])
    np.savez(tmp_path / "a.npz", first, second)
    np.testing.assert_array_equal(load_scans(tmp_path / "a.npz").points, [first, second])


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_of_more_columns_the_first_three_are_taken_and_told(suffix: str, tmp_path: Path) -> None:
    wide = np.concatenate([POINTS, POINTS * 0 + 7], axis=1)[None].repeat(2, axis=0)
    np.savez(tmp_path / "a.npz", points=wide)
    np.save(tmp_path / "a.npy", wide)
    with pytest.warns(InputWarning, match="6 columns, of which the first three are taken as x y z: 150 in frame 0"):
        np.testing.assert_array_equal(load_scans(tmp_path / f"a.{suffix}").points[0], POINTS)
    np.save(tmp_path / "a.npy", wide[..., :5])
    assert "(150, 5)" in refused(tmp_path / "a.npy")


def ply(n: int | str, body: bytes, extra: str = "") -> bytes:
    return f"ply\nformat binary_little_endian 1.0\nelement vertex {n}\n{XYZ}{extra}end_header\n".encode() + body


@pytest.mark.parametrize("n", [0, 149, 151, -1, -5, 10**12, 2**64])
def test_ply_that_holds_more_or_less_than_it_promises(n: int, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply(n, POINTS.tobytes()))
    assert "promises" in refused(path)
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {n}\n{XYZ}end_header\n")
    with open(path, "ab") as file:
        np.savetxt(file, POINTS)
    assert "promises" in refused(path)


def test_ply_with_padding_and_more_elements(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    rows = np.zeros(150, dtype=[("pad", "u1", 2), ("xyz", "<f4", 3), ("more", "u1", 2)])
    rows["xyz"] = POINTS
    pad = "property uchar pad\nproperty uchar pad\n"
    camera = "element camera 1\nproperty float view\nproperty list uchar float lens\n"
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 150\n{pad}{XYZ}{pad}{camera}end_header\n".encode()
    path.write_bytes(head + rows.tobytes() + struct.pack("<fB2f", 1, 2, 3, 4))
    np.testing.assert_array_equal(load_scans(path).points[0], POINTS)
    path.write_bytes(ply(150, bytes(150 * 16), "property float x\n"))
    assert "x more than once" in refused(path)


def test_ply_meshes_hold_their_faces(tmp_path: Path) -> None:
    path, mesh = tmp_path / "a.ply", trimesh.creation.icosphere(1)
    data = mesh.export(file_type="ply")
    for wrong in (79, 81, 2_000_000_000):
        path.write_bytes(data.replace(b"element face 80", b"element face %d" % wrong))
        line = refused(path)
        assert "promises" in line or "cut off" in line
    path.write_bytes(data.replace(b"element vertex 42", b"element vertex 41"))
    refused(path)


PCD = (
    "VERSION 0.7\nFIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT {count}\n"
    "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"
)


def pcd(path: Path, data: str, body: bytes, n: int = 150, count: str = "1 1 1 4") -> Path:
    path.write_bytes(PCD.format(n=n, count=count, data=data).encode() + body)
    return path


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_with_padding_holds_what_it_promises(data: str, tmp_path: Path) -> None:
    import lzf

    padded = np.zeros(150, dtype=[("xyz", "<f4", 3), ("pad", "u1", 4)])
    padded["xyz"] = POINTS
    columns = POINTS.T.tobytes() + bytes(600)
    packed = lzf.compress(columns)
    bodies = {
        "ascii": b"".join(b"%r  %r\t%r 0 0 0 0\n" % tuple(p) for p in POINTS.tolist()),
        "binary": padded.tobytes(),
        "binary_compressed": struct.pack("<II", len(packed), len(columns)) + packed,
    }
    np.testing.assert_array_equal(load_scans(pcd(tmp_path / "a.pcd", data, bodies[data])).points[0], POINTS)
    for n in (149, 151, 10**12):
        assert "promises" in refused(pcd(tmp_path / "a.pcd", data, bodies[data], n))
    for count in ("9223372036854775807 1 1 4", "10000000 1 1 4", "1 1 1 10000000", "0 1 1 4", "1 1 1"):
        refused(pcd(tmp_path / "a.pcd", data, bodies[data], count=count))
    assert "WIDTH -1" in refused(pcd(tmp_path / "a.pcd", data, bodies[data], -1))


@pytest.mark.parametrize("sizes", [(100, 2**32 - 1), (2**32 - 1, 2400), (2**32 - 1, 2**32 - 1)])
def test_pcd_that_lies_about_its_packed_size(sizes: tuple[int, int], tmp_path: Path) -> None:
    assert "promises" in refused(pcd(tmp_path / "a.pcd", "binary_compressed", struct.pack("<II", *sizes) + bytes(100)))


@pytest.mark.parametrize("suffix", ["obj", "off"])
@pytest.mark.parametrize("cut", [0.3, 0.5, 0.7, 0.9, -2, -4])
def test_text_meshes_that_are_cut_are_refused_or_told(suffix: str, cut: float, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    data = trimesh.creation.icosphere(2).export(file_type=suffix).strip()
    at = int(cut * len(data)) if cut > 0 else int(cut)
    at -= data[:at].endswith("\n")  # cut at the end of a line, an OBJ tells nothing
    path.write_text(data[:at])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            load_scans(path, mesh_samples=200)
        except InputError as error:
            assert str(path) in str(error)
        else:
            assert any("may be cut, dropped" in str(w.message) for w in told)


def glb(tree: dict[str, object], blob: bytes = bytes(8)) -> bytes:
    text = json.dumps({"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(blob)}], **tree}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize(
    ("tree", "complaint"),
    [
        ({"accessors": [{"componentType": 5126, "count": 2 * 10**9, "type": "VEC3"}]}, "unpacks to 24 GB"),
        ({"accessors": [{"componentType": 5126, "count": 10**8, "type": "VEC3"}]}, "no measured points"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 900}]}, "promises 900 bytes, 8 are"),
        ({"bufferViews": [{"buffer": 1, "byteLength": 8}]}, "outside of the file"),
        ({"scenes": [{"nodes": [0]}], "nodes": [{"children": [1]}, {"children": [0]}]}, "no tree"),
        ({"scenes": [{"nodes": [0]}], "nodes": [{"children": [1, 1]}, {}]}, "no tree"),
    ],
)
def test_glb_that_asks_for_what_it_has_not(tree: dict[str, object], complaint: str, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(glb(tree))
    assert complaint in refused(tmp_path / "a.glb")
