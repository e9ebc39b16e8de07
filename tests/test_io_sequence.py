"""Sequences and ground truth: every format says the same, what is dropped is told, what cannot be used is refused."""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from clouds import clouds, refusal
from rearticulate.errors import FitError, InputError, InputWarning
from rearticulate.io import check_sequence, load_sequence, load_truth, save_sequence, save_truth
from rearticulate.io.check import split_far_apart, spread_of
from rearticulate.records import GroundTruth, PointSequence

# -- the same points from every format ---------------------------------------------------------------------------------


def write_pcd(path: Path, points: np.ndarray, encoding: str) -> None:
    from pypcd4 import Encoding, PointCloud

    PointCloud.from_xyz_points(points.astype(np.float32)).save(path, Encoding(encoding))


def write_ply(path: Path, points: np.ndarray, encoding: str) -> None:
    """x, y, z in odd places among other properties."""
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[encoding]
    header = f"ply\nformat {encoding} 1.0\ncomment odd\nelement vertex {len(points)}\n"
    header += "property float z\nproperty uchar red\nproperty double x\nproperty float y\nend_header\n"
    if encoding == "ascii":
        body = "".join(f"{z!r} 7 {x!r} {y!r}\n" for x, y, z in points.tolist()).encode()
    else:
        body = b"".join(struct.pack(order + "fBdf", z, 7, x, y) for x, y, z in points.tolist())
    path.write_bytes(header.encode() + body)


WRITERS: dict[str, tuple[str, Callable[[Path, np.ndarray], object]]] = {
    "npy": (".npy", np.save),
    "xyz": (".xyz", np.savetxt),
    "xyz upper case": (".XYZ", np.savetxt),
    "xyz with normals": (".xyz", lambda path, p: np.savetxt(path, np.hstack([p, p]))),
    "txt with comment": (".txt", lambda path, p: np.savetxt(path, p, header="scan 3")),
    "csv with header": (".csv", lambda path, p: np.savetxt(path, p, delimiter=",", header="x,y,z", comments="")),
    "csv, semicolons": (".csv", lambda path, p: np.savetxt(path, p, delimiter=";", header="x;y;z", comments="//")),
    "pcd ascii": (".pcd", lambda path, p: write_pcd(path, p, "ascii")),
    "pcd binary": (".pcd", lambda path, p: write_pcd(path, p, "binary")),
    "pcd compressed": (".pcd", lambda path, p: write_pcd(path, p, "binary_compressed")),
    "ply ascii": (".ply", lambda path, p: write_ply(path, p, "ascii")),
    "ply little": (".ply", lambda path, p: write_ply(path, p, "binary_little_endian")),
    "ply big": (".ply", lambda path, p: write_ply(path, p, "binary_big_endian")),
    "ply by trimesh": (".ply", lambda path, p: trimesh.PointCloud(p).export(path)),
    "obj": (".obj", lambda path, p: path.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in p.tolist()))),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_of_a_folder_gives_the_same_points(name: str, tmp_path: Path) -> None:
    suffix, write = WRITERS[name]
    points = clouds()
    frames = (points[0], points[1][:120], points[2])
    for number, frame in zip((2, 10, 1), frames, strict=True):
        write(tmp_path / f"frame{number}{suffix}", frame)
    for ignored in (".hidden.ply", "README.txt", "camera.json", "_old.xyz"):
        (tmp_path / ignored).write_text("not a frame")
    for path in (tmp_path, tmp_path / f"frame*{suffix}"):
        sequence = load_sequence(path)
        assert sequence.names == tuple(f"frame{n}{suffix}" for n in (1, 2, 10))
        for loaded, frame in zip(sequence.points, (frames[2], frames[0], frames[1]), strict=True):
            np.testing.assert_allclose(loaded, frame, rtol=1e-6, atol=1e-7)
            assert loaded.dtype == np.float64
        assert [len(index) for index in sequence.index] == [150, 150, 120]


def test_archives_hold_a_stack_or_one_array_a_frame(tmp_path: Path) -> None:
    points = clouds()
    stacks = {"points": points, "times": np.arange(3)}, {"cloud": points}, {"scan2": points[1], "scan10": points[2]}
    for arrays, frames in zip(stacks, (points, points, points[1:]), strict=True):
        np.savez(tmp_path / "a.npz", **arrays)
        np.testing.assert_array_equal(np.array(load_sequence(tmp_path / "a.npz").points), frames)
    np.save(tmp_path / "a.npy", points)
    np.testing.assert_array_equal(np.array(load_sequence(tmp_path / "a.npy").points), points)


def test_notes_beside_frames_are_no_frames(tmp_path: Path) -> None:
    for f, frame in enumerate(clouds(2)):
        write_ply(tmp_path / f"{f}.ply", frame, "ascii")
    (tmp_path / "times.txt").write_text("0.0\n0.1\n")
    assert len(load_sequence(tmp_path)) == 2


@pytest.mark.parametrize("suffix", ["obj", "stl", "off", "glb", "ply"])
def test_meshes_are_sampled_on_their_surface_by_area(suffix: str, tmp_path: Path) -> None:
    size = np.array([1.0, 2.0, 4.0])
    for f in range(2):
        trimesh.creation.box(size).export(tmp_path / f"{f}.{suffix}")
    n = 2000
    first, second = load_sequence(tmp_path, mesh_samples=n, seed=3).points
    inside = size / 2 - np.abs(first)
    assert len(first) == n
    assert np.abs(inside.min(axis=1)).max() < 1e-6  # every point on a face, none outside
    share = np.bincount(inside.argmin(axis=1), minlength=3) / n
    expected = np.array([8.0, 4.0, 2.0]) / 14  # pairs of faces across x, y, z
    assert np.abs(share - expected).max() < 5 * np.sqrt(0.25 / n)
    assert set(map(tuple, first)).isdisjoint(map(tuple, second))  # frames are sampled afresh
    np.testing.assert_array_equal(load_sequence(tmp_path, mesh_samples=n, seed=3).points[0], first)


def test_real_sequences_load_without_a_word(data_folder: Path) -> None:
    for path in (data_folder / "roboart/nao.npz", data_folder / "household/microwave.npz"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            sequence = load_sequence(path)
        with np.load(path) as archive:
            np.testing.assert_array_equal(np.array(sequence.points), archive["points"])
        assert all((index == np.arange(4096)).all() for index in sequence.index)


# -- cleaning ----------------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 40), st.integers(0, 40))
def test_cleaning_drops_exactly_what_is_broken_or_double(seed: int, n_broken: int, n_double: int) -> None:
    from rearticulate.io.clean import BROKEN, DOUBLE, MISSING, SURPLUS, clean

    rng = np.random.default_rng(seed)
    raw = rng.integers(-9, 10, (200, 3)).astype(float)  # a coarse grid: many rows are double by chance, -0.0 among them
    raw[rng.random(200) < 0.1] *= -0.0
    raw = np.concatenate([raw, raw[rng.integers(0, 200, n_double)]])
    raw[rng.permutation(len(raw))[:n_broken], rng.integers(3)] = rng.choice([np.nan, np.inf, 3.4e38])
    raw = raw[(raw != 0).any(axis=1)]  # what sensors write where they saw nothing
    cleaned, _ = clean(raw, 10**6, rng)
    kept, row = cleaned.points, cleaned.rows
    good = raw[np.isfinite(raw).all(1) & (np.abs(raw) < 1e30).all(1)]
    assert {tuple(p) for p in kept.tolist()} == {tuple(p) for p in (good + 0.0).tolist()}
    assert len(np.unique(kept, axis=0)) == len(kept)
    np.testing.assert_array_equal(kept, raw[row])
    counts = {BROKEN: len(raw) - len(good), DOUBLE: len(good) - len(kept), MISSING: 0, SURPLUS: 0}
    assert cleaned.dropped == counts


def test_what_is_dropped_is_told_with_frame_and_number(tmp_path: Path) -> None:
    points = clouds()
    points[1, 5] = np.nan
    points[1, 9, 2] = np.inf
    points[2, 100:110] = points[2, :10]
    np.savez(tmp_path / "a.npz", points=points)
    with pytest.warns(InputWarning) as told:
        sequence = load_sequence(tmp_path / "a.npz")
    lines = [str(w.message) for w in told]
    assert len(lines) == 2
    assert "2 in frame 1" in lines[0]
    assert "10 in frame 2" in lines[1]
    for f in range(3):
        np.testing.assert_array_equal(sequence.points[f], points[f][sequence.index[f]])
    assert [len(p) for p in sequence.points] == [150, 148, 140]


def test_large_frames_are_thinned_the_same_way_each_time(tmp_path: Path) -> None:
    points = clouds(2, 1000)
    np.savez(tmp_path / "a.npz", points=points)
    with pytest.warns(InputWarning, match="700 in frame 0, 700 in frame 1"):
        first, again = (load_sequence(tmp_path / "a.npz", max_points=300, seed=1) for _ in range(2))
    for f in range(2):
        np.testing.assert_array_equal(first.index[f], again.index[f])
        np.testing.assert_array_equal(first.points[f], points[f][first.index[f]])
        assert len(set(first.index[f].tolist())) == 300
    assert first.source_points == (1000, 1000)
    assert (first.index[0] != first.index[1]).any()


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([1e-6, 1e-3, 0.0254, 1e3, 1e6]), st.integers(0, 1000))
def test_the_unit_does_not_matter(scale: float, seed: int) -> None:
    points = clouds(2, 150, seed)
    check_sequence(PointSequence.from_arrays(points * scale))
    split, scaled = split_far_apart(points[0]), split_far_apart(points[0] * scale)
    assert split.objects == scaled.objects
    np.testing.assert_allclose(spread_of(points[0] * scale), scale * spread_of(points[0]), rtol=1e-9)


def test_scale_multiplies(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=(clouds() * 1000).astype(np.int32))
    millimetres = (clouds() * 1000).astype(np.int32)
    sequence = load_sequence(tmp_path / "a.npz", scale=0.001)
    for loaded, frame, index in zip(sequence.points, millimetres, sequence.index, strict=True):
        np.testing.assert_allclose(loaded, frame[index] / 1000)
    with pytest.raises(InputError, match="scale"):
        load_sequence(tmp_path / "a.npz", scale=0)


# -- what cannot be used -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [0, 3, 50])
def test_too_few_points_are_refused_with_the_minimum(n: int, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", f0=clouds()[0], f1=clouds()[1][:n])
    line = refusal(tmp_path / "a.npz")
    assert f"f1: {n} point(s)" in line
    assert "100" in line


def test_one_frame_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=clouds(1))
    assert "2 frames" in refusal(tmp_path / "a.npz")
    write_ply(tmp_path / "a.ply", clouds()[0], "ascii")
    assert "one frame" in refusal(tmp_path / "a.ply")


def check(points: np.ndarray) -> None:
    check_sequence(PointSequence.from_arrays(points))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3), st.floats(0, 1e-3))
def test_lines_sheets_and_single_points_are_refused_solids_are_not(seed: int, size: float, noise: float) -> None:
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    frames = rng.uniform(-1, 1, (3, 200, 3)) + 10
    frames_of = lambda *extent: (frames * extent + noise * rng.normal(size=frames.shape)) @ turn.T * size  # noqa: E731
    check(frames_of(1, 0.5, 0.2))
    with pytest.raises(InputError, match="frame 0: the points lie on a line"):
        check(frames_of(1, 0, 0))
    with pytest.raises(InputError, match="every frame is flat"):
        check(frames_of(1, 0.7, 0))
    with pytest.raises(InputError, match="frame 0: all 200 points are the same"):
        check(np.ones((3, 200, 3)) * size)
    one_sheet = frames_of(1, 0.5, 0.2)
    one_sheet[1] = frames_of(1, 0.7, 0)[1]
    check(one_sheet)  # a folded sheet may be flat once


def two_objects(gap: float, share: float, seed: int = 0) -> np.ndarray:
    """(3, 1000, 3): two unit cubes with `gap` between them; the second has this share of the points."""
    points = np.random.default_rng(seed).random((3, 1000, 3))
    points[:, : round(1000 * share), 0] += 1 + gap
    return points


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(2.0, 1e4), st.floats(0.08, 0.92))
def test_two_objects_far_apart_are_refused(seed: int, gap: float, share: float) -> None:
    with pytest.raises(InputError, match="2 separate objects") as caught:
        check(two_objects(gap, share, seed))
    told = float(str(caught.value).split("objects ")[1].split(" m")[0])
    assert 0.99 * gap <= told <= 1.01 * gap + 0.5  # three digits; a sample of a cube ends a little before its face


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 1.0), st.floats(0.1, 0.9))
def test_a_gap_smaller_than_the_object_is_accepted(seed: int, gap: float, share: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(two_objects(gap, share, seed))


def test_two_objects_in_some_frames_only_are_accepted() -> None:
    points = two_objects(5, 0.3)
    points[1] = np.random.default_rng(1).random((1000, 3))
    check(points)


def test_stray_points_are_told_and_hide_no_second_object() -> None:
    points = np.random.default_rng(0).random((3, 1000, 3))
    points[1, :4] += 20
    with pytest.warns(InputWarning, match=r"4 stray point\(s\) .* in frame 1"):
        check(points)
    points = two_objects(5, 0.4)
    points[:, 999] += 1e6
    with pytest.raises(InputError, match="2 separate objects"):
        check(points)


def test_non_finite_arrays_are_refused() -> None:
    points = clouds()
    points[2, 7, 1] = np.nan
    with pytest.raises(InputError, match=r"frame 2: .*finite"):
        check(points)


# -- files that are not what they should be ----------------------------------------------------------------------------


def test_paths_that_lead_nowhere(tmp_path: Path) -> None:
    assert "no such file or folder" in refusal(tmp_path / "missing")
    assert "no such file or folder" in refusal(tmp_path / "missing.npz")
    assert "no file matches" in refusal(tmp_path / "*.ply")
    assert "empty folder" in refusal(tmp_path)
    (tmp_path / "scan.las").write_text("")
    assert ".ply" in refusal(tmp_path)
    assert "(.las)" in refusal(tmp_path / "scan.las")


def test_mixed_formats_are_named(tmp_path: Path) -> None:
    write_ply(tmp_path / "0.ply", clouds()[0], "ascii")
    np.savetxt(tmp_path / "1.xyz", clouds()[1])
    assert ".ply, .xyz" in refusal(tmp_path)


def test_archives_of_anything_else(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    path.write_text("1 2 3\n")
    assert "not a .npz file" in refusal(path)
    np.savez(path, points=clouds()[:, :, :2])
    assert "expected one (F, N, 3) array" in refusal(path)
    np.savez(path, points=clouds().astype(str))
    assert "real numbers" in refusal(path)
    np.savez(path, points=clouds())
    path.write_bytes(path.read_bytes()[:-100])
    assert "damaged" in refusal(path)
    np.savez(path)
    assert "0 frame" in refusal(path)


class Bomb:
    """Writes a file when unpickled."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[object, ...]:
        return (Path.touch, (self.target,))


def test_pickles_are_refused_unopened(tmp_path: Path) -> None:
    bomb, target = Bomb(tmp_path / "exploded"), tmp_path / "exploded"
    array = np.array([bomb, None], dtype=object)
    np.savez(tmp_path / "a.npz", points=array)
    np.save(tmp_path / "a.npy", array)
    (tmp_path / "b.npz").write_bytes(pickle.dumps(bomb))
    for name in ("a.npz", "a.npy", "b.npz"):
        assert "pickled Python objects are refused" in refusal(tmp_path / name)
    assert not target.exists()
    pickle.loads((tmp_path / "b.npz").read_bytes())
    assert target.exists()  # it would have


@pytest.mark.parametrize("name", [n for n in WRITERS if n.startswith(("pcd", "ply", "npy"))])
@pytest.mark.parametrize("cut", [7, 40, 0.5, -1, -12])
def test_files_cut_short_are_refused_by_name(name: str, cut: float, tmp_path: Path) -> None:
    suffix, write = WRITERS[name]
    for f, frame in enumerate(clouds(2)):
        write(tmp_path / f"f{f}{suffix}", frame)
    path = tmp_path / f"f1{suffix}"
    whole = path.read_bytes()
    path.write_bytes(whole[: int(cut * len(whole)) if cut == 0.5 else int(cut)])
    if "ascii" in name and cut < 0:  # the last line ends early: there is nothing to tell that from a short number
        path.write_bytes(whole[: whole.rindex(b"\n", 0, len(whole) + int(cut)) + 1])
    with pytest.raises(InputError, match=f"f1{suffix}") as caught:
        load_sequence(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", ["stl", "off", "glb", "ply"])
def test_meshes_cut_short_are_refused_by_name(suffix: str, tmp_path: Path) -> None:
    for f in range(2):
        trimesh.creation.icosphere(2).export(tmp_path / f"f{f}.{suffix}")
    path = tmp_path / f"f1.{suffix}"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match=f"f1.{suffix}"):
        load_sequence(tmp_path)


@settings(max_examples=60, deadline=None)
@given(
    content=st.binary(max_size=300), suffix=st.sampled_from(["ply", "pcd", "xyz", "npy", "obj", "stl", "off", "glb"])
)
def test_no_bytes_break_a_reader(content: bytes, suffix: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("noise")
    starts = {"ply": b"ply\nformat ascii 1.0\n", "npy": b"\x93NUMPY", "pcd": b"VERSION 0.7\n", "off": b"OFF\n"}
    for f in range(2):
        (folder / f"f{f}.{suffix}").write_bytes(starts.get(suffix, b"") + content)
    with pytest.raises(InputError) as caught:
        load_sequence(folder)
    assert "\n" not in str(caught.value)


def test_permission_denied_is_one_line() -> None:
    """In a process of its own, without the rights of root."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        path = Path(folder) / "a.npz"
        np.savez(path, points=clouds())
        path.chmod(0)
        drop = "import os; os.setuid(65534); " if os.geteuid() == 0 else ""
        program = f"from rearticulate.io import load_sequence; {drop}load_sequence({str(path)!r})"
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1] == f"rearticulate.errors.InputError: {path}: Permission denied"


# -- writing -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sizes", [(150, 150), (150, 120, 200)])
def test_saved_sequences_load_again(sizes: tuple[int, ...], tmp_path: Path) -> None:
    frames = [clouds(1, n, seed=n)[0] for n in sizes]
    save_sequence(tmp_path / "a.npz", PointSequence.from_arrays(frames))
    for loaded, frame in zip(load_sequence(tmp_path / "a.npz").points, frames, strict=True):
        np.testing.assert_array_equal(loaded, frame)
    with np.load(tmp_path / "a.npz") as archive:
        assert {archive[name].dtype for name in archive.files} == {np.dtype(np.float32)}


def same(a: GroundTruth, b: GroundTruth) -> bool:
    rest = [f.name for f in fields(GroundTruth) if f.name != "labels"]
    return all(map(np.array_equal, a.labels, b.labels)) and all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in rest
    )


def test_ground_truth_round_trip_of_real_files(data_folder: Path, tmp_path: Path) -> None:
    for name in ("roboart/nao", "roboart/panda", "household/cabinet"):
        path = data_folder / f"{name}.truth.npz"
        truth = load_truth(path)
        assert len(truth.labels) == len(truth.poses)
        assert (truth.joint_type is None) == name.endswith("nao")
        save_truth(tmp_path / "t.npz", truth)
        assert same(truth, load_truth(tmp_path / "t.npz"))
        with np.load(path) as old, np.load(tmp_path / "t.npz") as new:
            assert set(old.files) == set(new.files)
            for key in old.files:
                np.testing.assert_array_equal(old[key], new[key])


def ragged_truth() -> GroundTruth:
    return GroundTruth(
        labels=(np.array([0, 1, 1]), np.array([1, 0])),
        poses=np.tile(np.eye(4), (2, 2, 1, 1)),
        parent=np.array([-1, 0]),
        novel=np.zeros((0, 2, 4, 4)),
        joint_type=("", "prismatic"),
        joint_axis=np.array([[0, 0, 0], [0, 0, 1.0]]),
        joint_point=np.zeros((2, 3)),
        joint_state=np.array([[0, 0], [0, 0.1]]),
    )


def test_ground_truth_of_frames_that_differ_in_size(tmp_path: Path) -> None:
    truth = ragged_truth()
    save_truth(tmp_path / "t.npz", truth)
    assert same(truth, load_truth(tmp_path / "t.npz"))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"poses": None}, "lacks poses"),
        ({"labels_000": None, "labels_001": None}, "lacks labels"),
        ({"joint_axis": None}, "no joint_axis"),
        ({"labels_001": np.array([0, 2])}, "0 to 1"),
        ({"parents": np.array([-1, 4])}, "parent"),
        ({"joint_state": np.zeros((3, 2))}, "expected (2, 2)"),
    ],
)
def test_broken_ground_truth_is_refused(change: dict[str, np.ndarray | None], complaint: str, tmp_path: Path) -> None:
    save_truth(tmp_path / "t.npz", ragged_truth())
    with np.load(tmp_path / "t.npz") as archive:
        arrays = {**archive, **change}
    np.savez(tmp_path / "t.npz", **{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(InputError) as caught:
        load_truth(tmp_path / "t.npz")
    assert complaint in str(caught.value)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    path = tmp_path / "a.npz"
    save_sequence(path, PointSequence.from_arrays(clouds()))
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(FitError, match="cannot be written"):
            save_sequence(path, PointSequence.from_arrays(clouds(9)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.npz"]
