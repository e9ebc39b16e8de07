"""Names as mere text wherever they stand: in HTML, in the labels of a plotly figure, in a script."""

from __future__ import annotations

import html
import json

from rearticulate.report.summary import jsonable

_IN_SCRIPTS = {ord(c): f"\\u{ord(c):04x}" for c in "<>&"}


def in_html(text: object) -> str:
    """Between tags and in quoted attributes; what UTF-8 cannot say (bytes of a file name) becomes a question mark."""
    return html.escape(str(text).encode("utf-8", "replace").decode("utf-8"))


def in_label(text: str) -> str:
    """In a figure, where plotly reads links and some tags of HTML."""
    return html.escape(text, quote=False)


def in_script(value: object) -> str:
    """JSON, in ASCII, in which nothing can end, nest or comment out a script element."""
    return json.dumps(jsonable(value), separators=(",", ":")).translate(_IN_SCRIPTS)
