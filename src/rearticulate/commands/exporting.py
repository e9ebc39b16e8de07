"""`export`: a result becomes files for simulators and viewers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rearticulate.commands.options import check_up
from rearticulate.commands.outcome import say
from rearticulate.commands.outputs import check_folder
from rearticulate.commands.show import print_json
from rearticulate.errors import InputError
from rearticulate.export.robot import ExportConfig
from rearticulate.export.write import FORMATS, MARK, save_robot
from rearticulate.extras import needs
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.shape.body import ShapeConfig


@dataclasses.dataclass(frozen=True)
class ExportOptions:
    """What the command line says about an export."""

    formats: str = ",".join(FORMATS)
    name: str | None = None
    overwrite: bool = False

    def chosen(self) -> list[str]:
        """The formats, each once."""
        names = list(dict.fromkeys(text.strip().lower() for text in self.formats.split(",") if text.strip()))
        unknown = [name for name in names if name not in FORMATS]
        if unknown or not names:
            raise InputError(f"--format {self.formats}: choose from {', '.join(FORMATS)}")
        return names


def export_config(
    margin: float,
    density: float,
    floating: bool,
    up: str,
    collision: str,
    max_faces: int,
    effort: float,
    velocity: float,
    friction: float | None,
    damping: float | None,
) -> ExportConfig:
    """The settings, checked."""
    shape = ShapeConfig(max_faces=max_faces, density=density, collision=collision)  # type: ignore[arg-type]
    return ExportConfig(
        shape, margin, floating, check_up(up), effort=effort, velocity=velocity, friction=friction, damping=damping
    )


def run_export(source: Path, out: Path | None, options: ExportOptions, config: ExportConfig, as_json: bool) -> None:
    """The command `export`."""
    chosen, out = options.chosen(), source / "export" if out is None else out
    result, sequence = load_result(source), load_sequence_of(source)
    check_folder(out, MARK, "export", options.overwrite)
    with needs("export"):
        files, facts = save_robot(
            out, result, sequence, name=options.name or source.resolve().name, formats=chosen, config=config
        )
    _tell(out, chosen, files, facts, as_json)


def _tell(out: Path, chosen: Sequence[str], files: Sequence[Path], facts: dict[str, Any], as_json: bool) -> None:
    for link in facts["links"]:
        if link["note"]:
            say(f"note: {link['name']}: {link['note']}")
    if as_json:
        print_json({"out": str(out), "files": [str(path) for path in files], **facts})
    else:
        print("\n".join(f"{kind:<8}{out / path}" for kind, path in zip(chosen, files, strict=True)))
