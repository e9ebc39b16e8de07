"""The pictures in the folder of a result: `parts.png` (rest posture from two sides, joint axes) and `frames.png`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from rearticulate.io.atomic import atomic_file
from rearticulate.records import FitResult, PointSequence, Posture
from rearticulate.render.camera import View
from rearticulate.render.canvas import Canvas, row
from rearticulate.render.panels import PanelData, draw, draw_axes
from rearticulate.render.viewpoint import best_view

STRIP = 5  # frames in the strip
PIXELS = 420


def write_pictures(folder: str | Path, result: FitResult, sequence: PointSequence) -> tuple[Path, Path]:
    """Write both into an existing folder and return their paths."""
    parts, frames = Path(folder) / "parts.png", Path(folder) / "frames.png"
    view = best_view(result, sequence)
    for path, picture in ((parts, parts_picture), (frames, frames_picture)):
        with atomic_file(path) as partial:
            picture(result, sequence, view).save(partial, format="PNG")
    return parts, frames


def parts_picture(result: FitResult, sequence: PointSequence, view: View) -> Image.Image:
    """The canonical cloud in parts with its joint axes, from two sides."""
    model, rest, pictures = result.model, Posture.rest(result.model), []
    for side in (view, replace(view, azimuth=view.azimuth + 90.0)):
        data = PanelData(result, sequence, rest, side, (PIXELS, PIXELS))
        canvas = Canvas(side.camera([model.points], data.pixels))
        points, labels = data.posed(rest)
        data.dots(canvas, points, data.colors[labels])
        draw_axes(model, rest, None, canvas)
        pictures.append(canvas.picture())
    return row(pictures)


def frames_picture(result: FitResult, sequence: PointSequence, view: View) -> Image.Image:
    """Up to five frames as measured, coloured by part, all on one scale."""
    shown = np.unique(np.linspace(0, len(sequence) - 1, min(STRIP, len(sequence))).round().astype(int))
    data = PanelData(result, sequence, Posture.rest(result.model), view, (PIXELS // 2, PIXELS // 2))
    return row([draw(data, "parts", float(f), f"frame {f}") for f in shown])
