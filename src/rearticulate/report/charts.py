"""The 2D charts of the page, as plain plotly dictionaries."""

from __future__ import annotations

from typing import Any

import numpy as np

from rearticulate.records import FitResult
from rearticulate.report.escape import in_label

Figure = dict[str, Any]
MAIN, MARKED = "#4c78a8", "#e4572e"


def residual_chart(result: FitResult) -> Figure:
    """Mean distance of each frame's points to the model, mm, as far as the sampling does not explain it."""
    told = result.residual if result.misfit is None else result.misfit
    unit = "mm" if result.misfit is None else "mm beyond the sampling"
    return _bars(list(range(len(told))), (1000 * np.asarray(told)).tolist(), result.model.canonical, "frame", unit)


def energy_chart(result: FitResult) -> Figure:
    """What canonical frames were chosen by, of every one that was tried."""
    frames = sorted(result.energies)
    values = [result.energies[f] for f in frames]
    figure = _bars(frames, values, result.model.canonical, "canonical frame", "energy")
    figure["layout"]["xaxis"]["tickvals"] = frames
    return figure


def time_chart(result: FitResult) -> Figure:
    """Seconds a stage."""
    trace = {
        "type": "bar",
        "orientation": "h",
        "y": [in_label(s.name) for s in result.stages],
        "x": [s.seconds for s in result.stages],
        "marker": {"color": MAIN},
        "hovertemplate": "%{y}: %{x:.2f} s<extra></extra>",
    }
    layout = {
        "xaxis": {"title": {"text": "seconds"}},
        "yaxis": {"type": "category", "autorange": "reversed", "automargin": True},
    }
    return {"data": [trace], "layout": layout}


def _bars(x: list[int], y: list[float], marked: int, x_title: str, y_title: str) -> Figure:
    trace = {
        "type": "bar",
        "x": x,
        "y": y,
        "marker": {"color": [MARKED if f == marked else MAIN for f in x]},
        "hovertemplate": "%{x}: %{y:.4g}<extra></extra>",
    }
    layout = {
        "xaxis": {"title": {"text": x_title}},
        "yaxis": {"title": {"text": y_title}, "rangemode": "tozero", "automargin": True},
    }
    return {"data": [trace], "layout": layout}
