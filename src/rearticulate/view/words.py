"""What the panels say of an object, as HTML: viser would read a name in Markdown as images, links and tags."""

from __future__ import annotations

from pathlib import Path

from rearticulate.io.palette import part_hex
from rearticulate.records import FitResult, KinematicModel, PointSequence
from rearticulate.report.confidence import confidence
from rearticulate.report.escape import in_html
from rearticulate.report.summary import headline, joint_range
from rearticulate.report.tables import tree

_SQUARE = "display:inline-block;width:9px;height:9px;border-radius:2px;margin-right:6px;"


def says(text: str) -> str:
    """Mere text."""
    return _panel(in_html(text))


def title(name: str, result: FitResult, sequence: PointSequence) -> str:
    """What an object is called, and what it is."""
    return _panel(f"<b>{in_html(name)}</b> · " + in_html(" · ".join(headline(result, sequence)[:3])))


def described(result: FitResult, part: int) -> str:
    """A part and its joint."""
    model = result.model
    count = int((model.labels == part).sum())
    lines = [f"<b>{in_html(model.names[part])}</b> (<code>{part_hex(model.n_parts)[part]}</code>), {count} points"]
    if part > 0:
        parent = model.names[model.parent[part]]
        lines.append(in_html(f"{model.joint_type[part]} on {parent}, {joint_range(model, part)}"))
        lines.append(in_html(confidence(model.joint_type[part], result.joints[part])))
    return _panel("<br>".join(filter(None, lines)))


def written(word: str, path: Path) -> str:
    """Where something was written."""
    return _panel(f"{in_html(word)}: <code>{in_html(path)}</code>")


def tree_of(model: KinematicModel) -> str:
    """The tree of the report, with the few styles that it takes from its page."""
    html = tree(model).replace('class="swatch" style="', f'style="{_SQUARE}')
    return _panel(html.replace("<ul", '<ul style="list-style:none;margin:0;padding-left:11px"'))


def _panel(html: str) -> str:
    return f'<div style="padding:0 1em;font-size:0.85em;overflow-wrap:anywhere">{html}</div>'
