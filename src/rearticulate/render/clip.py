"""Moving pictures: GIF by Pillow, MP4 (H.264) by PyAV."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from importlib import import_module
from pathlib import Path

import numpy as np
from PIL import Image

from rearticulate.errors import InputError
from rearticulate.extras import needs
from rearticulate.geometry.se3 import transform
from rearticulate.geometry.thin import thinned
from rearticulate.io.atomic import atomic_file
from rearticulate.io.palette import part_colors
from rearticulate.records import Array, IntArray, KinematicModel, Motion
from rearticulate.render.camera import View
from rearticulate.render.canvas import INK, WHITE, Canvas, row
from rearticulate.render.panels import BUDGET, PanelData, draw

FORMATS = (".gif", ".mp4")
RATE = 15  # pictures a second
STEPS = 4  # pictures a frame of the sequence
MOST = 90  # pictures one way
DOT = 3.5  # pixels a point
COLORS = 128  # of a GIF
NEARLY = 12  # off white is white there, since Pillow looks colours up in boxes of this size


def film(
    data: PanelData, panels: Sequence[str], progress: Callable[[float], None] = lambda share: None
) -> list[Image.Image]:
    """The panels side by side, from the first frame to the last and back."""
    last = len(data.sequence) - 1
    times = np.linspace(0.0, last, max(2, min(STEPS * last + 1, MOST)))
    pictures = []
    for k, time in enumerate(times):
        pictures.append(row([draw(data, name, float(time)) for name in panels]))
        progress((k + 1) / len(times))
    return there_and_back(pictures)


def dragged(
    model: KinematicModel,
    way: Motion,
    source: Array,
    part: IntArray,
    target: Array,
    pixels: tuple[int, int] = (480, 480),
) -> list[Image.Image]:
    """A model on its way to clicked targets (K, 3); source (K, 3) in the canonical frame, on parts (K,)."""
    ends = [model.pose(way.q[k], way.T_world_root[k]) for k in (0, -1)]
    camera, colors = View().camera([*ends, target], pixels), part_colors(model.n_parts).astype(np.float64)
    rows = thinned(len(model.points), BUDGET)
    pictures = []
    for T in model.forward(way.q, way.T_world_root):
        canvas = Canvas(camera)
        canvas.points(transform(T[model.labels[rows]], model.points[rows]), colors[model.labels[rows]], DOT)
        for here, there in zip(transform(T[part], source), target, strict=True):
            canvas.line(np.stack([here, there]), INK, 1.4)
            canvas.cross(there, INK)
        pictures.append(canvas.picture())
    return pictures


def there_and_back(pictures: list[Image.Image]) -> list[Image.Image]:
    """So that a loop does not jump."""
    return pictures + pictures[-2:0:-1]


def check_clip(path: Path) -> None:
    """An InputError where no clip can be written under this name: another suffix, or PyAV is absent."""
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a clip is written as {' or '.join(FORMATS)}")
    if path.suffix.lower() == ".mp4":
        with needs("video"):
            import_module("av")


def write_clip(path: Path, pictures: Sequence[Image.Image]) -> None:
    """Write .gif or .mp4, whole or not at all."""
    check_clip(path)
    with atomic_file(path) as partial:
        _write_gif(partial, pictures) if path.suffix.lower() == ".gif" else _write_mp4(partial, pictures)


def _write_gif(path: Path, pictures: Sequence[Image.Image]) -> None:
    """One palette for all pictures, without dither: small, and nothing flickers."""
    sample = row(list(pictures[:: max(1, len(pictures) // 4)]))
    palette = sample.quantize(COLORS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    colors = np.array(palette.getpalette()).reshape(-1, 3)
    colors[np.abs(colors - WHITE).max(axis=1) < NEARLY] = WHITE  # it is averaged away otherwise
    palette.putpalette(colors.ravel().tolist())
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    frames[0].save(
        path, format="GIF", save_all=True, append_images=frames[1:], duration=round(1000 / RATE), loop=0, optimize=False
    )


def _write_mp4(path: Path, pictures: Iterable[Image.Image]) -> None:
    import av

    with av.open(str(path), "w", format="mp4") as container:
        stream = None
        for picture in pictures:
            even = picture.crop((0, 0, picture.width // 2 * 2, picture.height // 2 * 2))
            if stream is None:
                stream = container.add_stream("libx264", rate=Fraction(RATE))
                stream.width, stream.height, stream.pix_fmt = even.width, even.height, "yuv420p"
                stream.options = {"crf": "20", "movflags": "faststart"}
            container.mux(stream.encode(av.VideoFrame.from_image(even)))
        if stream is not None:
            container.mux(stream.encode())
