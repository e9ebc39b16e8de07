"""Results and stages on disk: exact round trips, nothing half-written, nothing foreign replaced, damage is told."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from rearticulate.errors import FitError, InputError
from rearticulate.geometry.se3 import exp_se3, is_rigid
from rearticulate.io import StageStore, check_output, load_model, load_result, load_sequence_of, save_result
from rearticulate.io.palette import part_colors, part_hex
from rearticulate.records import FitResult, JointDiagnostics, KinematicModel, Motion, PointSequence, StageTime
from toy_result import toy

FILES = ["arrays.npz", "canonical.ply", "config.json", "joints.csv", "model.json"]
TYPES = ("revolute", "prismatic", "fixed")


def some_result(seed: int = 0, n_parts: int = 4, sizes: tuple[int, ...] = (30, 20, 25)) -> FitResult:
    """A result with random numbers everywhere, infinities where a fit may leave them."""
    rng = np.random.default_rng(seed)
    P, F = n_parts, len(sizes)
    axis = rng.normal(size=(P, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    axis[0] = 0
    model = KinematicModel(
        canonical=F - 1,
        parent=np.array([-1, *(rng.integers(0, j) for j in range(1, P))]),
        joint_type=("floating", *(TYPES[j % 3] for j in range(P - 1))),
        axis=axis,
        origin=rng.normal(size=(P, 3)),
        limits=np.sort(rng.normal(size=(P, 2))),
        names=tuple(f'part "{j}", Ärmel' for j in range(P)),
        points=rng.normal(size=(40, 3)),
        labels=rng.integers(0, P, 40),
    )
    diagnostics = JointDiagnostics(*rng.random(4).tolist(), "prismatic", np.inf, True)
    unknown = JointDiagnostics(None, 0.0, np.inf, None, "", None, False, "did not move")
    return FitResult(
        model=model,
        motion=Motion(rng.normal(size=(F, P)), exp_se3(rng.normal(size=(F, 6)))),
        labels=tuple(rng.integers(0, P, n) for n in sizes),
        joints=(unknown, *([diagnostics] * (P - 1))),
        energy=float(rng.random()),
        energies={0: 0.1, F - 1: np.inf},
        residual=rng.random(F),
        stages=(StageTime("track", 0.25), StageTime("refine", 1e-9)),
        config={"track": {"radius": 0.1, "names": ["a", "b"], "on": True, "none": None}},
        seed=seed,
        notes=("stopped at 40 parts", "too few frames"),
        machine="a CPU, a kernel",
        sampling=rng.random(F),
    )


def sequence_of(result: FitResult) -> PointSequence:
    return PointSequence.from_arrays([np.full((len(frame), 3), 0.5) for frame in result.labels])


def assert_same(a: Any, b: Any) -> None:
    """Equal to the last bit, field by field."""
    assert type(a) is type(b)
    if is_dataclass(a):
        for f in fields(a):
            assert_same(getattr(a, f.name), getattr(b, f.name))
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    else:
        assert a == b or (np.isnan(a) and np.isnan(b))


# -- round trips -------------------------------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), n_parts=st.integers(1, 6), sizes=st.lists(st.integers(0, 9), min_size=2, max_size=4))
def test_round_trip_is_exact(
    seed: int, n_parts: int, sizes: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    result = some_result(seed, n_parts, tuple(sizes))
    folder = tmp_path_factory.mktemp("run") / "out"
    save_result(folder, result, sequence_of(result))
    assert_same(load_result(folder), result)
    assert_same(load_model(folder), result.model)
    assert_same(load_model(folder / "model.json"), result.model)
    assert sorted(os.listdir(folder)) == FILES
    assert os.listdir(folder.parent) == ["out"]


def test_the_text_files_are_what_their_names_say(tmp_path: Path) -> None:
    result = some_result(sizes=(5, 5))
    save_result(tmp_path / "out", result, sequence_of(result))
    no_constants = {"parse_constant": lambda text: pytest.fail(f"{text} is not JSON")}
    record = json.loads((tmp_path / "out/model.json").read_text(encoding="utf-8"), **no_constants)
    assert json.loads((tmp_path / "out/config.json").read_text()) == result.config == record["config"]
    assert record["parts"][0]["parent"] is None
    with open(tmp_path / "out/joints.csv", newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    names = result.model.names
    assert header == ["frame", f"{names[1]} [rad]", f"{names[2]} [m]"]  # the root and fixed joints have no value
    table = np.array(rows, dtype=float)
    np.testing.assert_array_equal(table[:, 0], [0, 1])
    np.testing.assert_array_equal(table[:, 1:], result.motion.q[:, 1:3])


def test_the_canonical_cloud_shows_the_parts(tmp_path: Path) -> None:
    result = some_result()
    save_result(tmp_path / "out", result, sequence_of(result))
    cloud: Any = trimesh.load(tmp_path / "out/canonical.ply", process=False)
    np.testing.assert_array_equal(cloud.vertices, result.model.points)
    colors = part_colors(result.model.n_parts)[result.model.labels]
    np.testing.assert_array_equal(np.asarray(cloud.colors)[:, :3], colors)


def test_palette_tells_forty_parts_apart() -> None:
    rgb = part_colors(40) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_lms = [[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]]
    to_lab = [[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]]
    lab = np.cbrt(linear @ np.transpose(to_lms)) @ np.transpose(to_lab)  # Oklab; a just visible step is 0.02
    distance = np.linalg.norm(lab[:, None] - lab, axis=-1) + 9 * np.eye(40)
    assert distance.min() > 0.1
    assert lab[:, 0].max() < 0.9  # readable on white
    np.testing.assert_array_equal(part_colors(90)[40:80], part_colors(40))
    assert part_hex(3) == ["#" + bytes(color.tolist()).hex() for color in part_colors(3)]


def test_labels_of_another_sequence_are_not_saved(tmp_path: Path) -> None:
    result = some_result(sizes=(5, 5))
    with pytest.raises(ValueError, match="other frames"):
        save_result(tmp_path / "out", result, PointSequence.from_arrays(np.zeros((2, 6, 3))))
    assert os.listdir(tmp_path) == []


# -- folders -----------------------------------------------------------------------------------------------------------


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_an_earlier_result_is_replaced_on_demand_only(tmp_path: Path) -> None:
    old, new = some_result(1), some_result(2, 3)
    folder = tmp_path / "out"
    folder.mkdir()
    save_result(folder, old, sequence_of(old))  # an empty folder is fine
    StageStore(folder / "stages").save("track", "f", {"a": np.arange(3)})
    with pytest.raises(InputError, match="earlier result"):
        save_result(folder, new, sequence_of(new))
    assert_same(load_result(folder), old)
    save_result(folder, new, sequence_of(new), overwrite=True)
    assert_same(load_result(folder), new)
    assert StageStore(folder / "stages").load("track", "f") is not None
    assert os.listdir(tmp_path) == ["out"]


def test_a_stopped_fit_may_end_in_its_own_folder(tmp_path: Path) -> None:
    result = some_result()
    StageStore(tmp_path / "out/stages").save("track", "f", {"a": np.arange(3)})
    save_result(tmp_path / "out", result, sequence_of(result))
    assert sorted(os.listdir(tmp_path / "out")) == [*FILES, "stages"]


def test_foreign_folders_and_files_are_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home/thesis.tex").write_text("years of work")
    (tmp_path / "file").write_text("text")
    before = contents(tmp_path)
    result = some_result()
    for name in ("home", "file"):
        with pytest.raises(InputError, match=name):
            save_result(tmp_path / name, result, sequence_of(result), overwrite=True)
        with pytest.raises(InputError, match=name):
            check_output(tmp_path / name, overwrite=True)
    assert contents(tmp_path) == before


class DiskFull:
    """An `extra` that fails as a full disk does, after everything else was written."""

    def __call__(self, folder: Path) -> None:
        assert sorted(os.listdir(folder)) == FILES
        raise OSError(28, "No space left on device")


@pytest.mark.parametrize("earlier", [False, True])
def test_a_full_disk_leaves_what_was_there(earlier: bool, tmp_path: Path) -> None:
    old, new = some_result(1), some_result(2)
    if earlier:
        save_result(tmp_path / "out", old, sequence_of(old))
    before = contents(tmp_path)
    with pytest.raises(FitError, match=r"out: cannot be written .No space left on device") as caught:
        save_result(tmp_path / "out", new, sequence_of(new), overwrite=True, extra=DiskFull())
    assert "\n" not in str(caught.value)
    assert contents(tmp_path) == before
    assert os.listdir(tmp_path) == ["out"] * earlier


def test_a_limit_of_the_system_leaves_nothing(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    result = some_result(sizes=(9000, 9000))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(FitError, match="cannot be written"):
            save_result(tmp_path / "out", result, sequence_of(result))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert os.listdir(tmp_path) == []


def test_more_files_can_be_part_of_the_whole(tmp_path: Path) -> None:
    result = some_result()
    report = lambda folder: (folder / "report.html").write_text("<p>")  # noqa: E731
    save_result(tmp_path / "out", result, sequence_of(result), extra=report)
    assert (tmp_path / "out/report.html").read_text() == "<p>"


# -- damage ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    result = some_result()
    save_result(tmp_path / "out", result, sequence_of(result))
    return tmp_path / "out"


def complaint(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_result(folder)
    assert "\n" not in str(caught.value)
    assert "out" in str(caught.value)
    return str(caught.value)


def change_record(folder: Path, **changes: Any) -> None:
    path = folder / "model.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    record["parts"][1].update({k: v for k, v in changes.items() if k in record["parts"][1]})
    record.update({k: v for k, v in changes.items() if k in record})
    path.write_text(json.dumps({k: v for k, v in record.items() if v != "gone"}), encoding="utf-8")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"format": 2}, "upgrade"),
        ({"format": "x"}, "no format number"),
        ({"parts": "gone"}, "'parts' is missing"),
        ({"parts": 7}, "damaged"),
        ({"energy": "much"}, "damaged"),
        ({"joint_type": "helical"}, "'helical'"),
        ({"parent": "nobody"}, "parent"),
        ({"parent": None}, "parent"),
        ({"name": 'part "0", Ärmel'}, "one name"),
        ({"axis": [0, 1]}, "damaged"),
        ({"diagnostics": {"residual": 1}}, "missing"),
    ],
)
def test_damaged_records_are_told_in_one_line(saved: Path, changes: dict[str, Any], expected: str) -> None:
    change_record(saved, **changes)
    assert expected in complaint(saved)


def test_damaged_files_are_told_in_one_line(saved: Path) -> None:
    arrays = saved / "arrays.npz"
    whole = arrays.read_bytes()
    with np.load(arrays) as archive:
        content = dict(archive)
    np.savez(arrays, **{k: v for k, v in content.items() if k != "q"})
    assert "'q' is missing" in complaint(saved)
    np.savez(arrays, **{**content, "q": content["q"][1:]})
    assert "T_world_root has shape (3, 4, 4), expected (2, 4, 4)" in complaint(saved)
    np.savez(arrays, **{**content, "labels": content["labels"] + 9})
    assert "labels must be from 0 to 3" in complaint(saved)
    np.savez(arrays, **{**content, "frame_offsets": content["frame_offsets"][::-1]})
    assert "frame_offsets" in complaint(saved)
    np.savez(arrays, **{**content, "q": content["q"].astype(object)})
    assert "pickled" in complaint(saved)
    arrays.write_bytes(whole[: len(whole) // 2])
    assert "arrays.npz: damaged" in complaint(saved)
    arrays.unlink()
    assert "arrays.npz: No such file" in complaint(saved)
    (saved / "model.json").write_text('{"format": 1,')
    assert "not valid JSON" in complaint(saved)
    (saved / "model.json").write_text("[1]")
    assert "no format number" in complaint(saved)
    (saved / "model.json").unlink()
    assert "no model.json" in complaint(saved)


def test_names_must_be_unique() -> None:
    result = some_result()
    with pytest.raises(InputError, match="unique"):
        replace(result.model, names=("a", "b", "b", "c"))


WRONG = [
    None, True, 0, -1, 99, 2**63, 10**30, 0.5, 1e300, "nan", "inf", "", "x", "base", "a\nb", "\u202e", "\ud800", [], {},
    [1, 2], [0, 0, 0], ["0", "0", "1"], [True, 0, 1.0], [3, 0, 0], [1e300] * 3, {"a": 1},
]  # fmt: skip


def places(node: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """All ways from the top of a JSON value to something in it."""
    inside = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [found for key, value in inside for found in [(*way, key), *places(value, (*way, key))]]


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_any_wrong_value_is_refused_or_leaves_a_sound_result(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("run") / "out"
    result, sequence = toy(20)
    save_result(folder, result, sequence)
    record = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    way = data.draw(st.sampled_from(places(record)))
    node = record
    for key in way[:-1]:
        node = node[key]
    node[way[-1]] = data.draw(st.sampled_from(WRONG))
    (folder / "model.json").write_text(json.dumps(record), encoding="utf-8")
    try:
        loaded = load_result(folder)
    except InputError as error:
        assert "\n" not in str(error) and "out" in str(error)
        return
    poses = loaded.model.forward(loaded.motion.q, loaded.motion.T_world_root)
    assert np.isfinite(poses).all() and is_rigid(poses).all()
    save_result(folder.parent / "again", loaded, sequence)
    assert_same(load_result(folder.parent / "again"), loaded)


@pytest.mark.parametrize("name", ["points", "labels", "q", "T_world_root", "residual", "frame_labels", "frame_points"])
def test_arrays_of_another_kind_are_refused(name: str, saved: Path) -> None:
    with np.load(saved / "arrays.npz") as archive:
        content = dict(archive)
    good = content[name]
    wrong = [good.astype(complex), good.astype("U8"), good.astype(bool), good.astype("M8[s]"), good[None], good[:0],
             np.full(good.shape, np.nan), np.full(good.shape, 1e300), good * 0 - 1]  # fmt: skip
    for array in wrong[: -1 if name in ("points", "q", "frame_points") else None]:
        np.savez(saved / "arrays.npz", **{**content, name: array})
        with pytest.raises(InputError):
            load_sequence_of(saved)
            load_result(saved)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"axis": [[0, 0, 0], [0, 0, 3], [1, 0, 0]]}, "length 1"),
        ({"axis": [[0, 0, 1], [0, 0, 1], [1, 0, 0]]}, "length 0"),
        ({"parent": [-1, 2, 1]}, "before their children"),
        ({"parent": [-1, -1, 1]}, "one root"),
        ({"limits": [[0, 0], [1, -1], [0, 1]]}, "in order"),
        ({"limits": [[0, 0], [1, np.inf], [0, 1]]}, "finite"),
        ({"names": ("a", "b\x1b[31m", "c")}, "printable"),
        ({"names": ("a", "x" * 300, "c")}, "300 letters"),
        ({"joint_type": ("floating", "floating", "prismatic")}, "only the root"),
        ({"labels": np.full(60, 3)}, "from 0 to 2"),
        ({"canonical": -1}, "canonical"),
        ({"points": np.zeros((0, 3)), "labels": np.zeros(0, int)}, "needs points"),
    ],
)
def test_models_are_checked_when_they_are_made(changes: dict[str, Any], expected: str) -> None:
    result, _ = toy(20)
    with pytest.raises(InputError, match=expected):
        replace(result.model, **changes)


# -- stages ------------------------------------------------------------------------------------------------------------


def test_stages_come_back_for_their_fingerprint_only(tmp_path: Path) -> None:
    store = StageStore(tmp_path / "stages")
    arrays = {"a": np.random.default_rng(0).normal(size=(3, 2)), "text": np.array("text"), "empty": np.zeros((0, 3))}
    assert store.load("track", "abc") is None
    store.save("track", "abc", arrays)
    loaded = store.load("track", "abc")
    assert loaded is not None
    assert loaded.keys() == arrays.keys()
    for key, value in arrays.items():
        np.testing.assert_array_equal(loaded[key], value)
    assert store.load("track", "abd") is None
    assert store.load("relax", "abc") is None
    store.save("track", "abd", {"b": np.arange(2)})
    assert store.load("track", "abc") is None
    assert os.listdir(tmp_path / "stages") == ["track.npz"]


@settings(max_examples=30, deadline=None)
@given(place=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_damaged_stages_are_forgotten(place: int, bit: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("stages")
    store, values = StageStore(folder), np.arange(50.0)
    store.save("track", "abc", {"a": values})
    whole = bytearray((folder / "track.npz").read_bytes())
    place %= len(whole)
    (folder / "track.npz").write_bytes(whole[:place])
    assert store.load("track", "abc") is None
    whole[place] ^= 1 << bit
    (folder / "track.npz").write_bytes(whole)
    loaded = store.load("track", "abc")
    assert loaded is None or all(np.array_equal(value, values) for value in loaded.values())


def test_no_folder_keeps_nothing_and_objects_are_refused(tmp_path: Path) -> None:
    nowhere = StageStore(None)
    nowhere.save("track", "abc", {"a": np.arange(3)})
    assert nowhere.load("track", "abc") is None
    with pytest.raises(TypeError, match="objects"):
        StageStore(tmp_path).save("track", "abc", {"a": np.array([None])})
    for key in ("../track", "", ".hidden"):
        with pytest.raises(ValueError, match="named by"):
            StageStore(tmp_path).save(key, "abc", {})
    assert os.listdir(tmp_path) == []
