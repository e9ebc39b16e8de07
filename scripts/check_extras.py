"""Every extra by itself: `python scripts/check_extras.py FOLDER [EXTRA ...]`.

Builds the wheel, installs it bare and with each extra alone into fresh environments below FOLDER, and runs every
command once. Each must work (exit code 0), or end with one line that names the extra (exit code 2);
an unknown page of the benchmark, and one whose data are not there, are refused. Prints a table;
exit code 1 where a command did anything else. Needs a network.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("", "export", "simulate", "paper", "video", "view", "simulators", "train")
COMMANDS = {
    "fit": "fit seq.npz -o out --overwrite --canonical 1 --config quick.json",
    "fit, paper": "fit seq.npz -o paper --overwrite --canonical 1 --preset paper --config quick.json --no-report",
    "info": "info result",
    "eval": "eval result seq.truth.npz --report",
    "export": "export result -o export --overwrite",
    "pose": "pose result -o posed.ply --overwrite",
    "retarget": "retarget result clicks.json -o posture --overwrite",
    "track": "track result seq.npz -o track --overwrite",
    "render, gif": "render result -o clip.gif --size 64 --panels parts --overwrite",
    "render, mp4": "render result -o clip.mp4 --size 64 --panels parts --overwrite",
    "simulate": "simulate box.urdf -o made.npz --frames 3 --points 200 --overwrite",
    "view": "view result --port 0",
    "bench": "bench no-such-page",
    "bench, loops": "bench loops -o bench",
    "train-flow": "train-flow -o run --steps 1 --overwrite --workers 0 --device cpu",
}
SERVES = {"view"}  # until it is told to end
MAY_REFUSE = {"bench", "bench, loops"}  # an unknown page, absent data
URDF = """<robot name="box"><link name="base"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
<link name="lid"><visual><origin xyz="0 0 1"/><geometry><box size="1 1 0.2"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="lid"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""
INPUTS = """
import json
from pathlib import Path
from toy_result import toy, toy_truth
from rearticulate.io.model import save_result
from rearticulate.io.sequence import save_sequence
from rearticulate.io.truth import save_truth
result, sequence = toy(100)
save_result("result", result, sequence)
save_sequence(Path("seq.npz"), sequence)
save_truth(Path("seq.truth.npz"), toy_truth())
click = {"source": [0.3, 0, 0], "target": [0.3, 0.05, 0], "part": "arm"}
Path("clicks.json").write_text(json.dumps({"clicks": [click]}))
Path("quick.json").write_text(json.dumps({"neural": {"chamfer_iterations": 3, "emd_iterations": 3}}))
"""


def make_inputs(python: str, work: Path) -> None:
    """What the commands read, in the folder `work`."""
    work.mkdir(parents=True, exist_ok=True)
    paths = os.pathsep.join(filter(None, (str(ROOT / "tests"), os.environ.get("PYTHONPATH"))))
    subprocess.run([python, "-c", INPUTS], cwd=work, env={**os.environ, "PYTHONPATH": paths}, check=True)
    (work / "box.urdf").write_text(URDF)


def outcome(name: str, code: int, errors: str) -> str:
    """ "works", the extra that is asked for, or "WRONG: ..." with the last line."""
    lines = [line for line in errors.splitlines() if line.strip()]
    last = lines[-1] if lines else ""
    if "unexpected" in errors or "Traceback" in errors:
        return f"WRONG: {last}"
    if code == 0:
        return "works"
    if code == 2 and 'pip install "rearticulate[' in last:
        return "asks for " + last.split("[")[1].split("]")[0]
    return "refuses" if code in (1, 2) and name in MAY_REFUSE else f"WRONG: {last}"


def run(name: str, program: list[str], work: Path) -> str:
    """The outcome of one command."""
    with tempfile.TemporaryFile("w+") as errors:
        command = [*program, *COMMANDS[name].split()]
        with subprocess.Popen(command, cwd=work, stdout=subprocess.PIPE, stderr=errors, text=True) as process:
            code = None
            if name in SERVES and process.stdout is not None and "http" in process.stdout.readline():
                process.terminate()
                code = 0
            process.communicate(timeout=600)
        errors.seek(0)
        return outcome(name, process.returncode if code is None else code, errors.read())


def install(extra: str, wheel: Path, folder: Path) -> Path:
    """A fresh environment with the wheel and one extra; returns its folder of programs."""
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    wanted = f"{wheel}[{extra}]" if extra else str(wheel)
    pip = [programs / "python", "-m", "pip", "install", "--quiet", "--quiet", "-c", ROOT / "constraints.txt", wanted]
    subprocess.run(pip, check=True)
    return programs


def main(folder: Path, extras: tuple[str, ...]) -> int:
    """Print the table; 1 where something is wrong."""
    pip_wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", folder / "wheel", ROOT]
    subprocess.run(pip_wheel, check=True)
    wheel, wrong = next((folder / "wheel").glob("rearticulate-*.whl")).resolve(), False
    for extra in extras:
        name = extra or "bare"
        programs = install(extra, wheel, folder / name).resolve()
        make_inputs(str(programs / "python"), folder / f"{name}-work")
        for command in COMMANDS:
            found = run(command, [str(programs / "rearticulate")], folder / f"{name}-work")
            wrong |= found.startswith("WRONG")
            print(f"| {name} | {command} | {found} |", flush=True)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), tuple(sys.argv[2:]) or EXTRAS))
