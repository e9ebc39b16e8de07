"""The 3D figures of the page, as plain plotly dictionaries (no plotly import: the browser draws them)."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from rearticulate.geometry.se3 import transform
from rearticulate.geometry.thin import thinned
from rearticulate.io.palette import part_hex
from rearticulate.records import FitResult, KinematicModel, PointSequence
from rearticulate.render.axes import axis_segments
from rearticulate.report.escape import in_label
from rearticulate.report.support import Support

Array = NDArray[np.floating]
Figure = dict[str, Any]

ANIMATION_BUDGET = 60_000  # points in all frames together
FRAME_BUDGET = 2000
FLOW_LINES = 300


def packed(values: Array) -> dict[str, str]:
    """A float array as plotly reads it from base64: a third of the text."""
    data = np.ascontiguousarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(data).decode("ascii")}


def animation(result: FitResult, sequence: PointSequence) -> Figure:
    """Every frame as measured, coloured by part, with the joint axes where the fit puts them."""
    model = result.model
    poses = model.forward(result.motion.q, result.motion.T_world_root)
    budget = min(FRAME_BUDGET, max(200, ANIMATION_BUDGET // len(sequence)))
    frames = []
    for f in range(len(sequence)):
        cloud = _cloud_traces(model.names, *_thin(sequence.points[f], result.labels[f], budget))
        frames.append([*cloud, _axes_trace(*named_axes(model, poses[f]))])
    start = model.canonical
    return {
        "data": frames[start],
        "frames": [{"name": str(f), "data": data} for f, data in enumerate(frames)],
        "layout": {"scene": _scene(_bounds(sequence.points)), **_player(len(frames), start)},
    }


def canonical_parts(result: FitResult) -> Figure:
    """The rest pose in parts with its joint axes."""
    model = result.model
    identity = np.broadcast_to(np.eye(4), (model.n_parts, 4, 4))
    data = _cloud_traces(model.names, *_thin(model.points, model.labels, 2 * FRAME_BUDGET))
    data.append(_axes_trace(*named_axes(model, identity)))
    return {"data": data, "layout": {"scene": _scene(_bounds([model.points]))}}


def true_parts(result: FitResult, labels: NDArray[np.integer]) -> Figure:
    """The rest pose in its true parts, each in the colour of the found part that shares most of its points."""
    model = result.model
    shared = np.zeros((int(labels.max()) + 1, model.n_parts))
    np.add.at(shared, (labels, model.labels), 1)
    true, found = linear_sum_assignment(-shared)
    partner = dict(zip(true.tolist(), found.tolist(), strict=True))
    spare = part_hex(model.n_parts + len(shared))[model.n_parts :]
    colors = part_hex(model.n_parts)
    points, own = _thin(model.points, labels, 2 * FRAME_BUDGET)
    data = [
        _points_trace(f"true part {t}", points[own == t], colors[partner[t]] if t in partner else spare[t], 2.6)
        for t in range(len(shared))
    ]
    return {"data": data, "layout": {"scene": _scene(_bounds([model.points]))}}


def misfit(result: FitResult, seen: Support) -> Figure:
    """Where on the object the fitted motion and the measured points differ, mm."""
    values = 1000 * seen.misfit()
    trace = _points_trace("misfit", seen.points, "#888888", 2.6)
    trace["marker"] = {
        "size": 2.6,
        "color": packed(values),
        "colorscale": "Viridis",
        "cmin": 0.0,
        "cmax": float(np.quantile(values, 0.99)) or 1.0,
        "colorbar": {"title": {"text": "mm"}, "thickness": 10, "len": 0.7, "outlinewidth": 0},
    }
    trace["hovertemplate"] = "%{marker.color:.2f} mm<extra></extra>"
    return {"data": [trace], "layout": {"scene": _scene(_bounds([result.model.points]))}}


def scene_flow(result: FitResult) -> Figure:
    """Where points of the rest pose go: their paths through all frames."""
    model = result.model
    rows = thinned(len(model.points), FLOW_LINES)
    labels = model.labels[rows]
    poses = model.forward(result.motion.q, result.motion.T_world_root)
    paths = np.stack([transform(T[labels], model.points[rows]) for T in poses], axis=1)  # (n, F, 3)
    data = [_points_trace("rest pose", model.points[thinned(len(model.points), FRAME_BUDGET)], "#9aa4b0", 1.6)]
    for j, color in enumerate(part_hex(model.n_parts)):
        lines = paths[labels == j]
        if len(lines):
            data.append(_line_trace(model.names[j], _with_breaks(lines), color, 3))
    return {"data": data, "layout": {"scene": _scene(_bounds([paths.reshape(-1, 3), model.points]))}}


def named_axes(model: KinematicModel, poses: Array) -> tuple[Array, list[str]]:
    """Both ends of every moving joint's axis (J, 2, 3) under part poses (P, 4, 4), and what to call it."""
    segments, joints = axis_segments(model, poses)
    return segments, [f"{model.names[j]}: {model.joint_type[j]}" for j in joints]


def _thin(points: Array, labels: NDArray[np.integer], budget: int) -> tuple[Array, NDArray[np.integer]]:
    rows = thinned(len(points), budget)
    return points[rows], labels[rows]


def _cloud_traces(names: Sequence[str], points: Array, labels: NDArray[np.integer]) -> list[dict[str, Any]]:
    colors = part_hex(len(names))
    return [_points_trace(name, points[labels == j], colors[j], 2.6) for j, name in enumerate(names)]


def _points_trace(name: str, points: Array, color: str, size: float) -> dict[str, Any]:
    return {
        "type": "scatter3d",
        "mode": "markers",
        "name": in_label(name),
        **_xyz(points),
        "marker": {"size": size, "color": color},
        "hovertemplate": "%{fullData.name}<br>%{x:.3f} %{y:.3f} %{z:.3f} m<extra></extra>",
    }


def _line_trace(name: str, points: Array, color: str, width: float) -> dict[str, Any]:
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": in_label(name),
        **_xyz(points),
        "line": {"color": color, "width": width},
        "connectgaps": False,
        "hoverinfo": "name",
    }


def _axes_trace(segments: Array, labels: list[str]) -> dict[str, Any]:
    trace = _line_trace("joint axes", _with_breaks(segments), "ink", 6)
    text = [t for label in map(in_label, labels) for t in (label, label, "")]
    return {**trace, "text": text, "hoverinfo": "text"}


def _with_breaks(lines: Array) -> Array:
    """(L, K, 3) polylines in one array, a NaN row after each."""
    return np.concatenate([lines, np.full((len(lines), 1, 3), np.nan)], axis=1).reshape(-1, 3)


def _xyz(points: Array) -> dict[str, Any]:
    return {name: packed(points[:, i]) for i, name in enumerate("xyz")}


def _bounds(clouds: Sequence[Array]) -> Array:
    low = np.min([c.min(axis=0) for c in clouds], axis=0)
    high = np.max([c.max(axis=0) for c in clouds], axis=0)
    return np.stack([low, high], axis=1)  # (3, 2)


def _scene(bounds: Array) -> dict[str, Any]:
    """One scale on all axes, the same in every frame."""
    margin = 0.04 * float(np.ptp(bounds, axis=1).max()) + 1e-9
    extent = np.ptp(bounds, axis=1) + 2 * margin
    axes = {
        f"{name}axis": {"range": [float(low - margin), float(high + margin)], "title": {"text": ""}, "nticks": 4}
        for name, (low, high) in zip("xyz", bounds, strict=True)
    }
    ratio = np.maximum(extent / extent.max(), 0.05) * 1.25
    return {
        **axes,
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
        "camera": {"eye": {"x": 1.35, "y": -0.95, "z": 0.55}},
    }


def _player(n_frames: int, start: int) -> dict[str, Any]:
    """Play and pause buttons and a slider below the scene."""
    show = {"mode": "immediate", "transition": {"duration": 0}}
    steps = [
        {"label": str(f), "method": "animate", "args": [[str(f)], {**show, "frame": {"duration": 0, "redraw": True}}]}
        for f in range(n_frames)
    ]
    play = {**show, "frame": {"duration": 350, "redraw": True}, "fromcurrent": True}
    buttons = [
        {"label": "▶", "method": "animate", "args": [None, play]},
        {"label": "❚❚", "method": "animate", "args": [[None], show]},
    ]
    place = {"type": "buttons", "direction": "left", "x": 0, "y": 0, "xanchor": "left", "yanchor": "top"}
    slider = {"active": start, "x": 0.16, "len": 0.84, "y": 0, "currentvalue": {"prefix": "frame ", "xanchor": "left"}}
    return {
        "updatemenus": [{**place, "showactive": False, "pad": {"t": 18}, "buttons": buttons}],
        "sliders": [{**slider, "pad": {"t": 0}, "steps": steps}],
    }
