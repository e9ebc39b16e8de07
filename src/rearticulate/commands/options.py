"""Options that several commands share, checked."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from rearticulate.errors import InputError
from rearticulate.io.budget import MAX_BYTES
from rearticulate.render.camera import View


@dataclass(frozen=True)
class InputOptions:
    """What the command line says about the files of points; see `io.sequence.load_sequence`."""

    scale: float = 1.0
    max_points: int = 20_000
    max_bytes: int = MAX_BYTES

    def keywords(self) -> dict[str, Any]:
        """For `load_sequence` and `load_scans`."""
        return asdict(self)


def check_up(up: str) -> str:
    """The axis that points up."""
    if up.removeprefix("-") not in ("x", "y", "z"):
        raise InputError(f"--up {up}: must be x, y or z, or one of these with a minus")
    return up


def parse_view(view: str, up: str) -> View | None:
    """ "35,15": azimuth and elevation in degrees; None for "auto"."""
    if view == "auto":
        return None
    try:
        azimuth, elevation = (float(x) for x in view.split(","))
    except ValueError:
        azimuth = elevation = math.nan
    if not (math.isfinite(azimuth) and -90 <= elevation <= 90):
        raise InputError(f"--view {view}: must be auto or two numbers, azimuth and elevation in degrees, such as 35,15")
    return View(azimuth, elevation, up)
