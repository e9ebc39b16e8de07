"""Results and metrics in the terminal, or as JSON. Only this goes to stdout."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.tree import Tree

from rearticulate.io.palette import part_hex
from rearticulate.records import Array, FitResult, KinematicModel, Metric, Motion, PointSequence, Posture
from rearticulate.report.summary import (
    children,
    energy_in_words,
    headline,
    joint_range,
    joint_rows,
    joint_value,
    jsonable,
    length,
)

PLAIN_WIDTH = 160  # where stdout is no terminal


def print_json(value: Any) -> None:
    """Strict JSON on stdout."""
    print(json.dumps(jsonable(value), indent=2))


def stdout() -> Console:
    """As wide as the terminal."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)


def show_result(result: FitResult, sequence: PointSequence | None = None) -> None:
    """Parts, tree, joints, energy and times on one screen."""
    console = stdout()
    console.print(" · ".join(headline(result, sequence)), style="bold")
    for note in result.notes:
        console.print(f"[yellow]note[/]    {escape(note)}")
    console.print(part_tree(result.model))
    if result.model.n_parts > 1:
        console.print(joint_table(result))
    energies = ", ".join(f"frame {f} {e:.4g}" for f, e in sorted(result.energies.items()))
    console.print(f"[dim]energy[/]  {energy_in_words(result)}" + (f"  (tried: {energies})" if energies else ""))
    console.print("[dim]time[/]    " + ", ".join(f"{escape(s.name)} {s.seconds:.1f} s" for s in result.stages))
    if result.machine:
        console.print(f"[dim]made on[/] {escape(result.machine)}")


def part_tree(model: KinematicModel) -> Tree:
    """The tree of parts, each with its joint to the parent and its number of points."""
    table, colors = children(model), part_hex(model.n_parts)

    def label(j: int) -> str:
        kind = "" if j == 0 else f"{model.joint_type[j]}, "
        count = int((model.labels == j).sum())
        return f"[{colors[j]}]■[/] {escape(model.names[j])} [dim]{kind}{count} points[/]"

    def grow(branch: Tree, j: int) -> None:
        for c in table[j]:
            grow(branch.add(label(c)), c)

    root = Tree(label(0), guide_style="dim")
    grow(root, 0)
    return root


def joint_table(result: FitResult) -> Table:
    """One line a joint."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    for head in ("joint of", "type", "axis", "origin, m", "observed range", "residual", "uncertainty"):
        table.add_column(head, no_wrap=head == "joint of")
    table.add_column("confidence", ratio=1)
    for row, joint in zip(joint_rows(result), result.joints[1:], strict=True):
        note = escape(row.note) if joint.determined else f"[yellow]{escape(row.note)}[/]"
        cells = (row.part, row.kind, row.axis, row.origin, row.range, row.residual, row.uncertainty)
        table.add_row(*map(escape, cells), note)
    return table


def show_metrics(metrics: Sequence[Metric]) -> None:
    """One line a metric."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("metric")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("better")
    for m in metrics:
        table.add_row(escape(m.key), f"{m.value:.4g}", escape(m.unit), m.better)
    stdout().print(table)


def show_clicks(clicks: Sequence[dict[str, Any]]) -> None:
    """One line a click."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("click", "part", "target, m", "misses by"):
        table.add_column(head)
    for k, click in enumerate(clicks):
        target = " ".join(f"{x:.3f}" for x in click["target"])
        table.add_row(str(k), escape(click["part"]), target, length(click["residual"]))
    stdout().print(table)


def show_change(model: KinematicModel, first: Posture, last: Posture) -> None:
    """One line a joint: its value before and after."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("joint of", "type", "was", "is", "observed range"):
        table.add_column(head)
    for j in range(1, model.n_parts):
        was, now = (joint_value(model, j, p.q) for p in (first, last))
        table.add_row(escape(model.names[j]), model.joint_type[j], was, now, joint_range(model, j))
    stdout().print(table)


def show_scans(model: KinematicModel, names: Sequence[str], motion: Motion, residual: Array) -> None:
    """One line a scan: how far its points lie from the model, and the joint values."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    for head in ("scan", "residual", *model.names[1:]):
        table.add_column(escape(head))
    for f, name in enumerate(names):
        values = (joint_value(model, j, motion.q[f]) for j in range(1, model.n_parts))
        table.add_row(escape(name), length(float(residual[f])), *values)
    stdout().print(table)


def show_facts(facts: dict[str, str]) -> None:
    """Name and value, a line each."""
    table = Table.grid(padding=(0, 2))
    for name, value in facts.items():
        table.add_row(f"[dim]{escape(name)}[/]", escape(value))
    stdout().print(table)
