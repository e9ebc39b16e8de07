"""`track`: new scans of a known object become postures and labels."""

from __future__ import annotations

import warnings
from pathlib import Path

from rearticulate.commands.fitting import FitOptions, write_result
from rearticulate.commands.options import InputOptions
from rearticulate.commands.progress import StageProgress
from rearticulate.commands.show import print_json, show_facts, show_scans
from rearticulate.errors import InputWarning
from rearticulate.io.atomic import reserve
from rearticulate.io.model import check_output, load_result, load_sequence_of
from rearticulate.io.order import describe_order
from rearticulate.io.palette import part_colors
from rearticulate.io.ply import write_cloud
from rearticulate.io.posture import named_values, save_posture
from rearticulate.io.sequence import load_scans
from rearticulate.localization.localize import Localization, followed, track
from rearticulate.observe.frames import point_spacing
from rearticulate.records import FitResult, PointSequence

STRANGE = 3.0  # mean distance of a scan from the model, in point spacings of the recording, that no noise explains


def run_track(
    folder: Path, source: str, out: Path, given: InputOptions, overwrite: bool, report: bool, as_json: bool
) -> None:
    """The command `track`."""
    with reserve(out):
        check_output(out, overwrite=overwrite)
        result, recorded = load_result(folder), load_sequence_of(folder)
        scans = load_scans(source, **given.keywords())
        with StageProgress() as progress:
            found = track(result, recorded, scans, lambda share: progress("track", share))
        warn_of_strangers(recorded, scans, found)
        whole, sequence = followed(result, scans, found)

        def each_scan(partial: Path) -> None:
            write_scans(partial / "scans", result, scans, found)

        write_result(out, whole, sequence, None, FitOptions(overwrite=overwrite, report=report), each_scan)
    if as_json:
        print_json({"out": str(out), "scans": describe(result, scans, found)})
    else:
        show_scans(result.model, scans.names, found.motion, found.residual)
        show_facts({"order": describe_order(scans.names)})
        print(out)


def warn_of_strangers(recorded: PointSequence, scans: PointSequence, found: Localization) -> None:
    """A line for every scan that lies beside the model."""
    usual = point_spacing(recorded.points)
    for name, residual in zip(scans.names, found.residual, strict=True):
        if residual > STRANGE * usual:
            text = (
                f"{name}: its points lie {1000 * residual:.3g} mm from the model, points of the recording "
                f"{1000 * usual:.3g} mm apart: another object, or a posture that was not found"
            )
            warnings.warn(text, InputWarning, stacklevel=2)


def write_scans(folder: Path, result: FitResult, scans: PointSequence, found: Localization) -> None:
    """Every scan coloured by part, and its posture."""
    folder.mkdir()
    colors = part_colors(result.model.n_parts)
    for f, (name, points) in enumerate(zip(scans.names, scans.points, strict=True)):
        stem = f"{f:03d}_{Path(name).stem.replace(' ', '_')}"
        write_cloud(folder / f"{stem}.ply", points, colors[found.labels[f]])
        save_posture(folder / f"{stem}.json", result.model, found.motion.posture(f), residual=float(found.residual[f]))


def describe(result: FitResult, scans: PointSequence, found: Localization) -> list[dict[str, object]]:
    """Every scan in plain numbers."""
    return [
        {
            "name": name,
            "joints": named_values(result.model, found.motion.posture(f)),
            "T_world_root": found.motion.T_world_root[f],
            "residual": found.residual[f],
        }
        for f, name in enumerate(scans.names)
    ]
