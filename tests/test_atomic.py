"""Old or new, whole, wherever a writer is killed; no litter after the next run; one writer at a time."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rearticulate.commands.fitting import FitOptions, write_result
from rearticulate.errors import FitError, InputError
from rearticulate.export.build import make_robot
from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.export.write import export
from rearticulate.io import atomic
from rearticulate.io.atomic import atomic_file, atomic_folder, reserve
from toy_result import toy

RESULT = toy(30)
WRITES = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "shutil.rmtree", "os.link"}
fork_only = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


def contents(path: Path) -> dict[str, bytes] | bytes | None:
    if path.is_dir():
        return {str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()}
    return path.read_bytes() if path.exists() else None


def child(work: Path, write: Callable[[], None], kill_at: int = 0) -> int:
    """Run `write` in a fork, killed before its `kill_at`-th change below `work`. Returns the number of changes."""
    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        seen = 0

        def count(event: str, args: tuple) -> None:
            nonlocal seen
            reads = event == "open" and not (isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR))
            if event not in WRITES or reads or not str(args[0]).startswith(str(work)):
                return
            seen += 1
            if seen == kill_at:
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        try:
            write()
            os.write(writer, str(seen).encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        told = pipe.read()
    os.waitpid(pid, 0)
    return int(told or 0)


def save(out: Path) -> None:
    write_result(out, *RESULT, None, FitOptions(overwrite=True, report=False))


@functools.cache
def made() -> Robot:
    return make_robot(*RESULT, "toy", ExportConfig())


def robot(out: Path) -> None:
    with atomic_folder(out) as partial:
        export(made(), partial, ("urdf", "ply"), ExportConfig())


def cloud(out: Path) -> None:
    with atomic_file(out) as partial:
        partial.write_text("new")


def two_renames(out: Path) -> None:
    """Where the system cannot exchange two folders."""
    atomic.exchange = lambda one, other: False  # in the fork alone
    save(out)


@fork_only
@pytest.mark.parametrize(("write", "every"), [(save, 1), (two_renames, 1), (robot, 3), (cloud, 1)])
def test_a_kill_at_any_change_leaves_the_old_or_the_new(write: Callable[[Path], None], every: int, tmp_path: Path):
    """In a process of its own: a fork of one with threads may never end."""
    command = [sys.executable, __file__, write.__name__, str(every), str(tmp_path / "work")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def kill_at_changes(write: Callable[[Path], None], every: int, work: Path) -> None:
    """Kill at every so many changes, and at the last; look; run once more."""
    out = work / "out"
    work.mkdir()
    if write is robot:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "cpu_count", lambda: 1)
            made()
    first = child(work, lambda: write(out))
    assert first > 2
    new = contents(out)
    kept = {"stages/a.npz": b"stage"} if write in (save, two_renames) else {}
    if isinstance(new, dict):
        new |= kept

    def earlier() -> dict[str, bytes] | bytes | None:
        """The same with a mark in it, and with stages."""
        if out.is_dir():
            for name, text in {"OLD": b"old", **kept}.items():
                (out / name).parent.mkdir(exist_ok=True)
                (out / name).write_bytes(text)
        else:
            out.write_bytes(b"old")
        return contents(out)

    earlier()
    points = child(work, lambda: write(out))
    assert points > 2
    seen = set()
    for at in [*range(1, points + 1, every), points]:
        old = earlier()
        child(work, lambda: write(out), at)
        if write is two_renames and not out.exists():
            with reserve(out):
                assert contents(out) == old, f"lost at change {at} of {points}"
        now = contents(out)
        assert now in (old, new), f"neither old nor new at change {at} of {points}"
        seen.add("old" if now == old else "new")
        child(work, lambda: write(out))
        assert contents(out) == new
        assert os.listdir(work) == ["out"]
    assert seen == {"old", "new"}


@fork_only
def test_a_lock_dies_with_its_process(tmp_path: Path) -> None:
    code = "import sys, time\nfrom rearticulate.io.atomic import reserve\n"
    code += "with reserve(sys.argv[1]):\n    print('mine', flush=True)\n    time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "out")], stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == b"mine"
        for write in (save, robot, cloud):
            with pytest.raises(InputError, match=r"out: in use by another run$"):
                write(tmp_path / "out")
        other.kill()
    cloud(tmp_path / "out")
    assert os.listdir(tmp_path) == ["out"]


def test_a_right_is_taken_once_and_leaves_nothing(tmp_path: Path) -> None:
    out = tmp_path / "new/folders/out"
    with reserve(out), reserve(out):
        pass
    assert os.listdir(tmp_path) == []
    with reserve(out):
        cloud(out)
    assert [str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*")] == ["new", "new/folders", "new/folders/out"]


def test_a_place_that_cannot_be_written_is_told_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    with pytest.raises(InputError, match=r"file is not a folder$"), reserve(tmp_path / "file/out"):
        pytest.fail("the work began")
    with pytest.raises(FitError, match="cannot be written"), reserve(tmp_path / ("n" * 250)):
        pytest.fail("the work began")
    assert os.listdir(tmp_path) == ["file"]


def test_a_folder_of_many_small_files_is_quick(tmp_path: Path) -> None:
    started = time.monotonic()
    with atomic_folder(tmp_path / "out") as partial:
        for k in range(300):
            with atomic_file(partial / f"{k}.txt") as file:
                file.write_text(str(np.pi * k))
    assert len(os.listdir(tmp_path / "out")) == 300
    assert time.monotonic() - started < 20


if __name__ == "__main__":
    kill_at_changes(globals()[sys.argv[1]], int(sys.argv[2]), Path(sys.argv[3]))
