"""The tables and the tree of the page, as HTML."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields

from rearticulate.io.palette import part_hex
from rearticulate.records import FitResult, KinematicModel, Metric
from rearticulate.report.advice import Advice
from rearticulate.report.escape import in_html
from rearticulate.report.summary import JointRow, children, joint_rows, jsonable

_HEADS = {"kind": "type", "range": "observed range", "origin": "origin, m", "note": "confidence"}


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells are HTML already."""
    head = "".join(f"<th>{h}</th>" for h in heads)
    body = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def joint_table(result: FitResult) -> str:
    """Type, axis, origin, range, residual, uncertainty and confidence of every joint."""
    names = [f.name for f in fields(JointRow)]
    colors = part_hex(result.model.n_parts)
    rows = []
    for j, row in enumerate(joint_rows(result), start=1):
        cells = [in_html(getattr(row, name)) for name in names]
        cells[0] = swatch(colors[j]) + cells[0]
        if not result.joints[j].determined:
            cells[-1] = f'<span class="warn">{cells[-1]}</span>'
        rows.append(cells)
    if not rows:
        return "<p>One rigid body: no joints.</p>"
    return table([_HEADS.get(n, n) for n in names], rows)


def metric_table(metrics: Sequence[Metric]) -> str:
    """Every metric with its unit and direction."""
    arrows = {"lower": "↓", "higher": "↑", "": ""}
    rows = [(in_html(m.key), f"{m.value:.4g}", in_html(m.unit), arrows[m.better]) for m in metrics]
    return table(["metric", "value", "unit", "better"], rows)


def advice_table(items: Sequence[Advice]) -> str:
    """What is uncertain, why, and what scan would settle it."""
    if not items:
        return "<p>Every joint is determined, every part was seen, and all frames fit alike.</p>"
    rows = [(in_html(item.about), in_html(item.finding), in_html(item.remedy)) for item in items]
    return table(["about", "uncertain", "what would settle it"], rows)


def tree(model: KinematicModel) -> str:
    """Nested lists, one entry a part."""
    table_of_children, colors = children(model), part_hex(model.n_parts)

    def entry(j: int) -> str:
        kind = "" if j == 0 else f' <span class="kind">{in_html(model.joint_type[j])}</span>'
        inner = "".join(entry(c) for c in table_of_children[j])
        inner = f"<ul>{inner}</ul>" if inner else ""
        return f"<li>{swatch(colors[j])}{in_html(model.names[j])}{kind}{inner}</li>"

    return f'<ul class="tree">{entry(0)}</ul>'


def configuration(result: FitResult) -> str:
    """The resolved configuration, the seed and the machine."""
    text = json.dumps(jsonable({"machine": result.machine, "seed": result.seed, **result.config}), indent=2)
    return f"<details><summary>Configuration</summary><pre>{in_html(text)}</pre></details>"


def swatch(color: str) -> str:
    """A small square of colour."""
    return f'<i class="swatch" style="background:{color}"></i>'
