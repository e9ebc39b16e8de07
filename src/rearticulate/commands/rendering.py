"""`render`: a clip of a result."""

from __future__ import annotations

import math
from pathlib import Path

from rearticulate.commands.progress import StageProgress
from rearticulate.errors import InputError
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.io.posture import load_posture
from rearticulate.render.camera import View
from rearticulate.render.clip import FORMATS, film, write_clip
from rearticulate.render.panels import PANELS, Story, novel_posture
from rearticulate.render.viewpoint import best_view


def run_render(
    folder: Path, out: Path, panels: str, posture: Path | None, size: int, view: str, up: str, overwrite: bool
) -> None:
    """The command `render`."""
    if out.suffix.lower() not in FORMATS:
        raise InputError(f"{out}: a clip is written as {' or '.join(FORMATS)}")
    if out.exists() and not overwrite:
        raise InputError(f"{out}: exists; name another file or ask for --overwrite")
    if not 64 <= size <= 2000:
        raise InputError(f"--size {size}: must be 64 to 2000 pixels")
    names, eye = chosen_panels(panels), parse_view(view, up)
    result, sequence = load_result(folder), load_sequence_of(folder)
    eye = eye or best_view(result, sequence, up=up)
    novel = novel_posture(result.model) if posture is None else load_posture(posture, result.model)
    story = Story(result, sequence, novel, eye, (size, size))
    with StageProgress() as progress:
        pictures = film(story, names, lambda share: progress("render", share))
    write_clip(out, pictures)
    print(out)


def chosen_panels(text: str) -> list[str]:
    """Names of panels, separated by commas."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or set(names) - set(PANELS):
        raise InputError(f"--panels {text}: choose from {', '.join(PANELS)}")
    return names


def parse_view(view: str, up: str) -> View | None:
    """ "35,15": azimuth and elevation in degrees; None for "auto"."""
    if up.removeprefix("-") not in ("x", "y", "z"):
        raise InputError(f"--up {up}: must be x, y or z, or one of these with a minus")
    if view == "auto":
        return None
    try:
        azimuth, elevation = (float(x) for x in view.split(","))
    except ValueError:
        azimuth = elevation = math.nan
    if not (math.isfinite(azimuth) and -90 <= elevation <= 90):
        raise InputError(f"--view {view}: must be auto or two numbers, azimuth and elevation in degrees, such as 35,15")
    return View(azimuth, elevation, up)
