"""`report.html`: one file that opens anywhere, without a network."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template

from rearticulate.records import FitResult, Metric, PointSequence
from rearticulate.report import charts, scene, tables
from rearticulate.report.summary import headline, jsonable

FILE_NAME = "report.html"


def write_report(
    folder: str | Path,
    result: FitResult,
    sequence: PointSequence,
    metrics: Sequence[Metric] | None = None,
    title: str | None = None,
) -> Path:
    """Write `report.html` into the folder and return its path."""
    path = Path(folder) / FILE_NAME
    path.write_text(_page(result, sequence, metrics, title or Path(folder).name), encoding="utf-8")
    return path


def _page(result: FitResult, sequence: PointSequence, metrics: Sequence[Metric] | None, title: str) -> str:
    template = resources.files("rearticulate.report").joinpath("page.html").read_text(encoding="utf-8")
    return Template(template).substitute(
        title=escape(title),
        facts="".join(f"<li>{escape(fact)}</li>" for fact in headline(result, sequence)),
        metrics=_section("Against ground truth", tables.metric_table(metrics)) if metrics else "",
        tree=tables.tree(result.model),
        joints=tables.joint_table(result),
        configuration=tables.configuration(result),
        figures=_script_json(_figures(result, sequence)),
        plotly=_plotly_source(),
    )


def _figures(result: FitResult, sequence: PointSequence) -> dict[str, scene.Figure]:
    figures = {
        "animation": scene.animation(result, sequence),
        "parts": scene.canonical_parts(result),
        "flow": scene.scene_flow(result),
        "residual": charts.residual_chart(result),
        "energy": charts.energy_chart(result),
        "time": charts.time_chart(result),
    }
    return figures


def _section(title: str, body: str) -> str:
    return f"<section><h2>{title}</h2>{body}</section>"


def _script_json(value: object) -> str:
    """JSON that cannot end its script element."""
    return json.dumps(jsonable(value), separators=(",", ":")).replace("</", "<\\/")


def _plotly_source() -> str:
    """plotly.js as shipped in the plotly package."""
    source = resources.files("plotly").joinpath("package_data/plotly.min.js").read_text(encoding="utf-8")
    return source.replace("</script", "<\\/script")
