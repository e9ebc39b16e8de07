"""`render`: a clip of a result."""

from __future__ import annotations

from pathlib import Path

from rearticulate.commands.options import check_up, parse_view
from rearticulate.commands.outputs import check_file
from rearticulate.commands.progress import StageProgress
from rearticulate.errors import InputError
from rearticulate.io.atomic import reserve
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.io.posture import load_posture
from rearticulate.render.clip import check_clip, film, write_clip
from rearticulate.render.panels import PANELS, PanelData, novel_posture
from rearticulate.render.viewpoint import best_view


def run_render(
    folder: Path, out: Path, panels: str, posture: Path | None, size: int, view: str, up: str, overwrite: bool
) -> None:
    """The command `render`."""
    check_clip(out)
    check_file(out, overwrite)
    if not 64 <= size <= 2000:
        raise InputError(f"--size {size}: must be 64 to 2000 pixels")
    names, eye = chosen_panels(panels), parse_view(view, check_up(up))
    result, sequence = load_result(folder), load_sequence_of(folder)
    eye = eye or best_view(result, sequence, up=up)
    novel = novel_posture(result.model) if posture is None else load_posture(posture, result.model)
    data = PanelData(result, sequence, novel, eye, (size, size))
    with reserve(out):
        with StageProgress() as progress:
            pictures = film(data, names, lambda share: progress("render", share))
        write_clip(out, pictures)
    print(out)


def chosen_panels(text: str) -> list[str]:
    """Names of panels, separated by commas."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or set(names) - set(PANELS):
        raise InputError(f"--panels {text}: choose from {', '.join(PANELS)}")
    return names
