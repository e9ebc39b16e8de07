"""Thousands of broken files of every kind: each is refused in one line, or what is read means something.

REARTICULATE_HOSTILE=20000 asks for so many; a process of its own reads them, bounded in memory and time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

CASES = int(os.environ.get("REARTICULATE_HOSTILE", "8000"))
SEED = int(os.environ.get("REARTICULATE_HOSTILE_SEED", "0"))
SECONDS = 20.0  # that one file may take
MEMORY = 2**30  # that one file may take, above what the process has when all is imported
NAMES = (
    *("seq.npz", "ragged.npz", "seq.npy", "scan.npy", "binary_little_endian.ply", "binary_big_endian.ply", "ascii.ply"),
    *("ascii.pcd", "binary.pcd", "binary_compressed.pcd", "scan.xyz", "scan.txt", "scan.csv", "mesh.ply", "mesh.obj"),
    *("mesh.stl", "mesh.off", "mesh.glb", "toy.truth.npz", "clicks.json", "posture.json", "config.json", "robot.urdf"),
    *("model.json", "arrays.npz"),
)


def attack(folder: Path, seed: int, cases: int) -> None:
    """Reads the broken files; prints a JSON line for each that is neither refused nor meaningful, and one of counts."""
    import shutil
    import signal
    import warnings

    import numpy as np

    from good_files import kinds
    from rearticulate.errors import InputError

    warnings.simplefilter("ignore")
    found = kinds(folder / "good")
    assert set(found) == set(NAMES)
    limit_memory()
    signal.signal(signal.SIGALRM, stop)
    outcomes = {name: Counter() for name in found}
    for case in range(cases):
        name = NAMES[case % len(NAMES)]
        rng = np.random.default_rng([seed, case, zlib.crc32(name.encode())])
        kind = found[name]
        path = folder / "box" / name
        shutil.rmtree(path.parent, ignore_errors=True)
        home = folder / "good" / ("result" if name in ("model.json", "arrays.npz") else ".")
        path.parent.mkdir()
        for beside in ("mesh.stl", "model.json", "arrays.npz"):
            if (home / beside).exists():
                shutil.copy(home / beside, path.parent)
        path.write_bytes(kind.edits[int(rng.integers(len(kind.edits)))](kind.content, rng))
        signal.setitimer(signal.ITIMER_REAL, SECONDS)
        try:
            kind.read(path)
            outcome, text = "read", ""
        except InputError as error:
            outcome, text = "refused", str(error)
            if "\n" in text or not text:
                outcome = "not one line"
        except BaseException as error:
            outcome, text = type(error).__name__, str(error)
        signal.setitimer(signal.ITIMER_REAL, 0)
        outcomes[name][outcome] += 1
        if outcome not in ("read", "refused"):
            print(json.dumps({"case": case, "name": name, "outcome": outcome, "text": text[:300]}), flush=True)
    print(json.dumps({"outcomes": outcomes}), flush=True)


def stop(*_: Any) -> None:
    raise TimeoutError(f"more than {SECONDS:.0f} s")


def limit_memory() -> None:
    """An allocation that is absurd fails at once, here, and is an error of the reader."""
    import resource

    status = Path("/proc/self/status").read_text()
    used = 1024 * int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmSize")))
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    if not Path("/proc/self/status").exists():
        pytest.skip("memory is bounded by means of Linux")
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "good").mkdir()
    command = [sys.executable, __file__, str(folder), str(SEED), str(CASES)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[-2000:]
    return [json.loads(line) for line in run.stdout.splitlines()]


@pytest.mark.parametrize("name", NAMES)
def test_broken_files_are_refused_or_mean_something(name: str, answers: list[dict[str, Any]]) -> None:
    *wrong, last = answers
    assert [answer for answer in wrong if answer["name"] == name] == []
    assert last["outcomes"][name]["refused"] > 0, "no edit was bad enough"


if __name__ == "__main__":
    attack(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
