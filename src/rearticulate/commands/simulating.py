"""`simulate`: a URDF becomes a sequence and its ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rearticulate.commands.show import print_json
from rearticulate.errors import InputError
from rearticulate.extras import needs
from rearticulate.io.atomic import reserve
from rearticulate.io.sequence import save_sequence
from rearticulate.io.truth import save_truth
from rearticulate.synth.simulate import simulate

TRUTH_SUFFIX = ".truth.npz"


def run_simulate(model: Path, out: Path, overwrite: bool, as_json: bool, settings: dict[str, Any]) -> None:
    """The command `simulate`. settings: keywords of `synth.simulate.simulate`."""
    truth_path = truth_beside(out)
    for path in (out, truth_path):
        if path.exists() and not overwrite:
            raise InputError(f"{path}: exists; name another file or ask for --overwrite")
    with reserve(truth_path), reserve(out):
        with needs("simulate"):
            sequence, truth = simulate(model, **settings)
        save_truth(truth_path, truth)
        save_sequence(out, sequence)
    if as_json:
        paths = {"sequence": str(out), "truth": str(truth_path)}
        print_json({**paths, "frames": len(sequence), "parts": len(truth.parent)})
    else:
        print(f"sequence  {out}  ({len(sequence)} frames, {len(truth.parent)} parts)")
        print(f"truth     {truth_path}")


def truth_beside(out: Path) -> Path:
    """seq.npz -> seq.truth.npz."""
    if out.suffix != ".npz" or out.name.endswith(TRUTH_SUFFIX):
        raise InputError(f"{out}: the sequence is written as an .npz file, its ground truth beside it")
    return out.with_name(out.stem + TRUTH_SUFFIX)
