"""Pieces of Markdown pages."""

from __future__ import annotations

from collections.abc import Iterable


def head(title: str, stamp: dict[str, str]) -> str:
    """Title and what the numbers depend on."""
    return f"# {title}\n\n" + "\n".join(f"- {key}: {value}" for key, value in stamp.items())


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table; the first column is text, the others are numbers."""
    head = list(heads)
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def seconds_cell(value: float | None) -> str:
    """Seconds in a table."""
    return "-" if value is None else f"{value:.1f}"
