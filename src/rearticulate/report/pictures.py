"""Static pictures: `parts.png` (rest pose in parts, two views, joint axes) and `frames.png` (a strip of frames).

`python -m rearticulate.report.pictures RESULT [OUTPUT]` draws both anew from the folder of a result.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rearticulate.io.palette import part_colors
from rearticulate.records import FitResult, PointSequence
from rearticulate.report.scene import axis_segments, thinned

Array = NDArray[np.floating]
View = tuple[float, float]  # azimuth, elevation, degrees

VIEWS: tuple[View, View] = ((35.0, 15.0), (125.0, 15.0))
BUDGET = 6000
STRIP = 5  # frames in the strip
INK = "#1d2733"


def write_pictures(folder: str | Path, result: FitResult, sequence: PointSequence) -> tuple[Path, Path]:
    """Write `parts.png` and `frames.png` into the folder and return their paths."""
    parts, frames = Path(folder) / "parts.png", Path(folder) / "frames.png"
    _save(parts_figure(result), parts)
    _save(frames_figure(result, sequence), frames)
    return parts, frames


def parts_figure(result: FitResult) -> Figure:
    """The canonical cloud in parts with its joint axes, from two views."""
    model = result.model
    identity = np.broadcast_to(np.eye(4), (model.n_parts, 4, 4))
    segments, _ = axis_segments(model, identity)
    figure, axes = _row(len(VIEWS), 4.6)
    for ax, view in zip(axes, VIEWS, strict=True):
        _draw_cloud(ax, model.points, model.labels, model.n_parts, view)
        for start, end in project(segments, view)[..., :2]:
            ax.plot([start[0], end[0]], [start[1], end[1]], color=INK, linewidth=1.6, solid_capstyle="round")
        _frame(ax, [model.points, segments.reshape(-1, 3)], view)
    return figure


def frames_figure(result: FitResult, sequence: PointSequence) -> Figure:
    """Up to five frames as measured, coloured by part, all on one scale."""
    shown = np.unique(np.linspace(0, len(sequence) - 1, min(STRIP, len(sequence))).round().astype(int))
    figure, axes = _row(len(shown), 2.6)
    for ax, f in zip(axes, shown, strict=True):
        _draw_cloud(ax, sequence.points[f], result.labels[f], result.model.n_parts, VIEWS[0], size=2.0)
        _frame(ax, [sequence.points[g] for g in shown], VIEWS[0])
        ax.set_title(f"frame {f}", fontsize=9, color="#66717f")
    return figure


def project(points: Array, view: View) -> Array:
    """Points (..., 3) as seen from a direction, without perspective: right, up, towards the eye."""
    azimuth, elevation = np.deg2rad(view)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    eye = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    return points @ np.stack([right, np.cross(eye, right), eye], axis=1)


def _draw_cloud(
    ax: Axes, points: Array, labels: NDArray[np.integer], n_parts: int, view: View, size: float = 4.0
) -> None:
    """The far points first and a little paler, so that the near ones stand out."""
    rows = thinned(len(points), BUDGET)
    seen = project(points[rows], view)
    order = np.argsort(seen[:, 2])
    depth = np.linspace(0.35, 0.0, len(order))[:, None]
    color = part_colors(n_parts)[labels[rows[order]]] / 255.0
    ax.scatter(seen[order, 0], seen[order, 1], s=size, c=color + depth * (1 - color), linewidths=0)


def _frame(ax: Axes, clouds: Sequence[Array], view: View) -> None:
    """Limits that hold all the clouds, one scale, nothing but the drawing."""
    seen = np.concatenate([project(c, view)[:, :2] for c in clouds])
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = 0.03 * float((high - low).max()) + 1e-9
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)
    ax.set_aspect("equal")
    ax.axis("off")


def _row(n: int, inches: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(n * inches, inches), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(1, n, squeeze=False)[0])


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=150)


def main(arguments: Sequence[str]) -> None:
    """Draw both pictures from the folder of a result, into that folder or another."""
    from rearticulate.io.model import load_result, load_sequence_of

    source, target = arguments[0], arguments[-1]
    Path(target).mkdir(parents=True, exist_ok=True)
    for path in write_pictures(target, load_result(source), load_sequence_of(source)):
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
