"""The whole fit, one line a stage."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
from collections.abc import Callable, Sequence

import numpy as np

from rearticulate.arrays import Array, Float, Int
from rearticulate.bounds import Seed, checked
from rearticulate.config import FitConfig
from rearticulate.errors import InputError
from rearticulate.io.check import check_sequence
from rearticulate.io.stages import StageStore
from rearticulate.joints.articulated import Articulated
from rearticulate.methods.device import choose_device
from rearticulate.methods.problem import Candidate, Problem, Start
from rearticulate.methods.registry import articulate_by, relax_by
from rearticulate.methods.spherical import BallTree
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import Frames, make_frames
from rearticulate.parallel import side_by_side
from rearticulate.parts.bodies import score_of
from rearticulate.parts.relaxed import Relaxed
from rearticulate.records import FitResult, PointSequence, StageTime
from rearticulate.results import to_result
from rearticulate.search.incomplete import complete_frames, fill_in
from rearticulate.version import code_hash, package_version

Progress = Callable[[str, float], None]

COVER = 0.75  # of the best; frames that cover less come last


class Clock:
    """Seconds by stage; forwards the progress."""

    def __init__(self, progress: Progress | None):
        self.seconds: dict[str, float] = {}
        self._progress, self._last = progress, time.perf_counter()
        self._stage: str | None = None

    def __call__(self, stage: str, fraction: float) -> None:
        now = time.perf_counter()
        if self._stage is not None:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._last
        self._stage, self._last = stage, now
        if self._progress is not None:
            self._progress(stage, fraction)


@checked
def fit(
    sequence: PointSequence,
    config: FitConfig | None = None,
    *,
    seed: Seed = 0,
    canonical: int | None = None,
    progress: Progress | None = None,
    store: StageStore | None = None,
    device: str = "auto",
) -> FitResult:
    """Fit a rearticulable model to a sequence.

    canonical: the rest frame; None tries a few and keeps the best. progress(stage, fraction done of it).
    store: where stage records are kept so that a stopped fit can go on. device: auto, cpu, or cuda, for the paper's
    solver (`methods.device`). Raises InputError on a sequence that cannot be fitted. The same seed gives the same bits
    on one type of CPU (`FitResult.machine`).
    """
    config = config or FitConfig()
    device = choose_device(device, config)
    check_sequence(sequence)
    F = len(sequence)
    if canonical is not None and not 0 <= canonical < F:
        raise InputError(f"canonical frame {canonical} does not exist: the sequence has frames 0 to {F - 1}")
    clock, store = Clock(progress), store or StageStore(None)
    clock("prepare", 0.0)
    rng = np.random.default_rng(seed)
    frames, chosen = working_frames(sequence, config, rng)
    known = complete_frames(np.diff(frames.start))
    left_out = canonical is not None and canonical not in known
    if left_out or config.deviation.joints == "ball" or not config.uses("incomplete frames"):
        known = np.arange(F)
    clock("prepare", 0.5)
    shown = frames.take(known)
    clock("prepare", 1.0)
    flow = scene_flow(shown, config, clock)
    solver = Solver(shown, flow, config, seed, clock, store, fingerprint(sequence, config, seed), device)
    silent = dataclasses.replace(solver, clock=Clock(None))
    place = None if canonical is None else int(np.searchsorted(known, canonical))
    cover = None if shown.views is None else shown.views.cover(shown.points)
    tried = canonical_frames(np.diff(shown.start), place, config, cover)
    starts = sorted(side_by_side(solver.start, silent.start, tried), key=lambda start: start.score)
    energies = {int(known[start.canonical]): start.score for start in starts}
    told = config.articulate == "direct"  # by the scores of the starts already, which of them is the best
    jobs = [starts] if told else [[start] for start in starts]
    fits = side_by_side(solver.candidate, silent.candidate, jobs)
    if not told:
        energies = {int(known[found.canonical]): found.energy for found in fits}
    best = min(fits, key=lambda found: found.energy)
    c = int(known[best.canonical])
    clock("finish", 0.0)
    if isinstance(best.tree, Articulated):
        best = Candidate(c, *fill_in(frames, known, c, best.tree, best.labels), best.energy, best.relaxed)
    clock("finish", 0.5)
    result = to_result(sequence, chosen, frames, best, config, seed, energies)
    clock("finish", 1.0)
    stages = tuple(StageTime(name, seconds) for name, seconds in clock.seconds.items())
    return dataclasses.replace(result, stages=stages)


def canonical_frames(
    counts: Int[Array, " F"], canonical: int | None, config: FitConfig, cover: Float[Array, " F"] | None = None
) -> list[int]:
    """The frames to fit from: near the middle, with the shortest ways to both ends, among those that show most.

    counts: points of every frame. Two at least, to choose from; more of a short or sparse sequence, where each costs
    less and says less. cover, where views are known: share of all points that each frame does not hide. Most points
    then only say that the object came near the sensor.
    """
    if canonical is not None:
        return [canonical]
    F = len(counts)
    tries = min(config.canonical_tries, max(2, config.canonical_work // int(counts.sum())))
    few = counts < config.canonical_share * counts.max() if cover is None else cover < COVER * cover.max()
    return sorted(range(F), key=lambda c: (few[c], abs(c - F // 2), c))[:tries]


def working_frames(
    sequence: PointSequence, config: FitConfig, rng: np.random.Generator
) -> tuple[Frames, list[Int[Array, " _"]]]:
    """What the solver sees of a sequence, and the rows of each of its frames that take part."""
    chosen = [working_rows(len(p), config.working_points, rng) for p in sequence.points]
    frames = make_frames(
        [p[rows] for p, rows in zip(sequence.points, chosen, strict=True)],
        origins=sequence.origins if config.uses("views") else (),
        sensor=[s[rows] for s, rows in zip(sequence.sensor, chosen, strict=False)],
    )
    return frames, chosen


def working_rows(n: int, limit: int, rng: np.random.Generator) -> Int[Array, " n"]:
    """The points of a frame that take part in the fit; the others get their labels at the end."""
    return np.arange(n) if n <= limit else np.sort(rng.choice(n, limit, replace=False))


def scene_flow(frames: Frames, config: FitConfig, progress: Progress) -> tuple[SceneFlow, ...]:
    """The observed flow between successive frames, where a half of the fit asks for it."""
    if not config.uses_paper:
        return ()
    from rearticulate.methods.paper.scene_flow import observed_flow

    progress("flow", 0.0)
    return observed_flow(frames, config, lambda done: progress("flow", done))


def fingerprint(sequence: PointSequence, config: FitConfig, seed: int) -> str:
    """Names everything a stage record depends on."""
    made_by = [package_version(), code_hash(), dataclasses.asdict(config), seed]
    digest = hashlib.sha256(json.dumps(made_by, sort_keys=True).encode())
    for array in (*sequence.points, *sequence.origins, *sequence.sensor):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@dataclasses.dataclass(frozen=True)
class Solver:
    """Runs the two halves of the fit from one canonical frame; finished halves are taken from the store."""

    frames: Frames
    flow: tuple[SceneFlow, ...]
    config: FitConfig
    seed: int
    clock: Clock
    store: StageStore
    mark: str
    device: str

    def problem(self, canonical: int) -> Problem:
        return Problem(self.frames, canonical, self.flow, self.config, self.clock, self.device)

    def candidate(self, starts: Sequence[Start]) -> Candidate:
        """The fit from the first of these starts, the others beside it."""
        canonical = starts[0].canonical
        F, M = self.frames.n_frames, len(self.frames.points)
        both = {"parent": ("P",), "T_root": (F, 4, 4), "labels": (M,), "energy": ()}
        screws = {**both, "twist": ("P", 6), "revolute": ("P",), "q": (F, "P")}
        balls = {**both, "centre": ("P", 3), "turn": (F, "P", 3)}
        for kind, shapes in ((Articulated, screws), (BallTree, balls)):
            saved = self.store.load(f"articulated-{canonical}", self.mark, shapes)
            if saved is not None:
                labels, value = saved.pop("labels"), float(saved.pop("energy"))
                return Candidate(canonical, kind(**saved), labels, value, starts[0].relaxed)
        rng = np.random.default_rng([self.seed, canonical, 1])
        found = articulate_by(self.config.articulate)(self.problem(canonical), starts, rng)
        everything = {**vars(found.tree), "labels": found.labels, "energy": found.energy}
        self.store.save(f"articulated-{canonical}", self.mark, everything)
        return found

    def start(self, canonical: int) -> Start:
        F, M = self.frames.n_frames, len(self.frames.points)
        shapes = {"T": (F, "P", 4, 4), "labels": (M,), "found": (), "score": ()}
        saved = self.store.load(f"relaxed-{canonical}", self.mark, shapes)
        if saved is not None:
            relaxed = Relaxed(saved["T"], saved["labels"], int(saved["found"]))
            return Start(canonical, relaxed, float(saved["score"]))
        rng = np.random.default_rng([self.seed, canonical, 0])
        model = relax_by(self.config.relax)(self.problem(canonical), rng)
        found = Start(canonical, model, score_of(self.frames, model.T, model.labels) / M)
        self.store.save(f"relaxed-{canonical}", self.mark, {**vars(model), "score": found.score})
        return found
