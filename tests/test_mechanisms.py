"""Mechanisms that are left out by name take no part in a fit, and all others do. No two mechanisms are left out of the
same fits, so each name is that of one mechanism."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest

from rearticulate.config import MECHANISMS, FitConfig
from rearticulate.pipeline import fit
from rearticulate.records import PointSequence
from rearticulate.synth import objects
from rearticulate.synth.articulated import record

HOME = {  # the function that a mechanism is, in the module that calls it
    "network": "parts.matched_starts.MatchedStarts.possible",
    "small middles": "joints.project._replace_small_middles",
    "hidden links": "joints.project.hidden_links",
    "restart": "search.relax.repair_poses",
    "simplify": "search.articulate.simplify",
    "second look": "search.articulate.restructure",
    "exchange": "search.explain.exchange",
    "sweep": "search.explain.sweep_bodies",
    "split": "search.explain.split_bodies",
    "slides": "search.moves.split.slides",
    "other starts": "search.articulate.combine_bodies",
    "seams": "search.articulate.cut_seams",
    "views": "observe.frames.make_views",
    "incomplete frames": "search.incomplete.between",
}


@pytest.fixture(scope="module")
def lamp() -> PointSequence:
    """A hinge, of which one frame shows only a half."""
    sequence, _ = record(objects.hinge(), frames=5, points=400, step_deg=15, seed=1)
    points = [p[p[:, 0] > p[:, 0].mean()] if f == 4 else p for f, p in enumerate(sequence.points)]
    return PointSequence.from_arrays(points, origins=[[[0.0, 0.0, 5.0]]] * 5)


def watched(function: Callable[..., Any], mechanism: str, seen: set[str]) -> Callable[..., Any]:
    def noted(*arguments: Any, **named: Any) -> Any:
        seen.add(mechanism)
        return function(*arguments, **named)

    return noted


@pytest.fixture
def used(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The mechanisms that were at work, all of them in this process."""
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    seen: set[str] = set()
    for mechanism, path in HOME.items():
        parts = path.split(".")
        owner = import_module(".".join(["rearticulate", *parts[:2]]))
        for name in parts[2:-1]:
            owner = getattr(owner, name)
        monkeypatch.setattr(owner, parts[-1], watched(getattr(owner, parts[-1]), mechanism, seen))
    return seen


@pytest.mark.parametrize("digit", range((len(MECHANISMS) - 1).bit_length()))
@pytest.mark.parametrize("value", [0, 1])
def test_half_of_the_mechanisms_are_left_out(digit: int, value: int, lamp: PointSequence, used: set[str]) -> None:
    without = tuple(name for k, name in enumerate(MECHANISMS) if k >> digit & 1 == value)
    fit(lamp, FitConfig(canonical_tries=2, without=without))
    idle = {*without, *({"slides"} if "split" in without else ())}
    assert used == set(MECHANISMS) - idle


def test_all_can_be_left_out_at_once(lamp: PointSequence, used: set[str]) -> None:
    result = fit(lamp, FitConfig(without=MECHANISMS), canonical=2)
    assert used == set() and result.model.n_parts >= 1
