"""`report.html`: one file that opens anywhere, without a network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

from rearticulate.io.atomic import atomic_file
from rearticulate.records import FitResult, IntArray, Metric, PointSequence
from rearticulate.report import charts, scene, tables
from rearticulate.report.advice import advice
from rearticulate.report.escape import in_html, in_script
from rearticulate.report.summary import headline
from rearticulate.report.support import Support, support

FILE_NAME = "report.html"


@dataclass(frozen=True)
class Score:
    """A result against ground truth. labels (N,): true part of every canonical point."""

    metrics: Sequence[Metric]
    labels: IntArray


def write_report(
    folder: str | Path,
    result: FitResult,
    sequence: PointSequence,
    score: Score | None = None,
    title: str | None = None,
) -> Path:
    """Write `report.html` into the folder and return its path. score: how the result compares with ground truth."""
    path = Path(folder) / FILE_NAME
    page = _page(result, sequence, score, title or Path(folder).name)
    with atomic_file(path) as partial:
        partial.write_text(page, encoding="utf-8")
    return path


def _page(result: FitResult, sequence: PointSequence, score: Score | None, title: str) -> str:
    template = resources.files("rearticulate.report").joinpath("page.html").read_text(encoding="utf-8")
    seen = support(result, sequence)
    return Template(template).substitute(
        title=in_html(title),
        facts="".join(f"<li>{in_html(fact)}</li>" for fact in headline(result, sequence)),
        notes="".join(f'<p class="warn">{in_html(note)}</p>' for note in result.notes),
        score=_score(score) if score else "",
        tree=tables.tree(result.model),
        joints=tables.joint_table(result),
        advice=tables.advice_table(advice(result, sequence, seen)),
        configuration=tables.configuration(result),
        figures=in_script(_figures(result, sequence, seen, score)),
        plotly=_plotly_source(),
    )


def _score(score: Score) -> str:
    metrics = _section("Against ground truth", tables.metric_table(score.metrics))
    parts = _section("True parts <small>canonical frame, in the colours of the parts found</small>", _figure("truth"))
    return f'<div class="pair">{metrics}{parts}</div>'


def _figure(name: str) -> str:
    return f'<div class="figure" id="{name}"></div>'


def _figures(result: FitResult, sequence: PointSequence, seen: Support, score: Score | None) -> dict[str, scene.Figure]:
    figures = {
        "animation": scene.animation(result, sequence),
        "parts": scene.canonical_parts(result),
        "flow": scene.scene_flow(result),
        "misfit": scene.misfit(result, seen),
        "residual": charts.residual_chart(result),
        "energy": charts.energy_chart(result),
        "time": charts.time_chart(result),
    }
    return figures if score is None else {**figures, "truth": scene.true_parts(result, score.labels)}


def _section(title: str, body: str) -> str:
    return f"<section><h2>{title}</h2>{body}</section>"


def _plotly_source() -> str:
    """plotly.js as shipped in the plotly package."""
    source = resources.files("plotly").joinpath("package_data/plotly.min.js").read_text(encoding="utf-8")
    return source.replace("</script", "<\\/script")
