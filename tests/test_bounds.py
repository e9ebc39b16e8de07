"""A fit whose assumptions break ends, says so, and is never silent."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby, pairwise

import numpy as np
import pytest

from rearticulate.config import FitConfig
from rearticulate.pipeline import fit
from rearticulate.progress import rounds, steps
from rearticulate.records import FitResult, PointSequence
from rearticulate.synth import objects
from rearticulate.synth.articulated import record

Calls = list[tuple[str, float]]
FEW = FitConfig(canonical_tries=1, max_parts=6, max_fragments=12)


def soft(frames: int = 6, points: int = 1500) -> PointSequence:
    """A bar that is bent anew, by random waves, in every frame."""
    rng = np.random.default_rng(0)
    clouds = []
    for _ in range(frames):
        x = rng.uniform(-1, 1, (points, 3)) * [1.0, 0.3, 0.3]
        x[:, 2] = np.where(rng.random(points) < 0.5, 0.3, -0.3)
        waves = zip(rng.normal(size=(8, 3)) * 5, rng.uniform(0, 6, 8), rng.normal(size=(8, 3)), strict=True)
        clouds.append(x + sum(0.08 * np.sin(x @ k + phase)[:, None] * d for k, phase, d in waves))
    return PointSequence.from_arrays(clouds)


@pytest.fixture(scope="module")
def bent() -> tuple[FitResult, Calls]:
    calls: Calls = []
    return fit(soft(), FEW, progress=lambda stage, done: calls.append((stage, done))), calls


def test_what_has_no_rigid_parts_stops_at_so_many_and_says_so(bent: tuple[FitResult, Calls]) -> None:
    result, _ = bent
    assert result.relaxed is not None and result.relaxed.T_world_part.shape[1] <= FEW.max_parts + 1
    assert result.model.n_parts <= FEW.max_parts + 1 + FEW.max_hidden
    assert len(result.notes) == 1 and result.notes[0].startswith("stopped at 6 of ")
    assert not any(joint.determined for joint in result.joints[1:])


def test_every_stage_tells_how_far_it_is(bent: tuple[FitResult, Calls]) -> None:
    _, calls = bent
    clean: Calls = []
    sequence, _ = record(objects.hinge(), frames=5, points=1200, step_deg=15, seed=1)
    result = fit(sequence, replace(FEW, max_parts=40), progress=lambda stage, done: clean.append((stage, done)))
    assert result.notes == ()
    for told in (calls, clean):
        stages = {stage: [done for _, done in group] for stage, group in groupby(told, key=lambda call: call[0])}
        assert list(stages) == ["prepare", "track", "segment", "articulate", "finish"]
        for stage, shares in stages.items():
            assert all(0 <= a <= b <= 1 for a, b in pairwise(shares)), stage
            assert len(set(shares)) > 2, stage


def test_steps_and_rounds_divide_a_whole() -> None:
    told: list[float] = []
    first, second = steps(told.append, 2)
    first(0.5)
    for _, _ in zip(rounds(second), range(3), strict=False):
        pass
    second(1.0)
    np.testing.assert_allclose(told, [0.25, 0.75, 0.5 + 1 / 3, 0.875, 1.0])
