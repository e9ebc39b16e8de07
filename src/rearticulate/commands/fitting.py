"""`fit` and `demo`: from a sequence to the folder of a result."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rearticulate.bounds import Seed, Settings
from rearticulate.commands.options import InputOptions
from rearticulate.commands.outcome import say
from rearticulate.commands.progress import StageProgress
from rearticulate.commands.show import print_json, show_facts, show_metrics, show_result
from rearticulate.config import FitConfig, load_config, preset
from rearticulate.errors import FitError, InputError
from rearticulate.io.atomic import reserve
from rearticulate.io.measure import warn_of_unit
from rearticulate.io.model import check_output, load_result, load_sequence_of, save_result
from rearticulate.io.order import describe_order
from rearticulate.io.sequence import load_sequence
from rearticulate.io.stages import StageStore
from rearticulate.records import FitResult, PointSequence
from rearticulate.report.html import FILE_NAME as REPORT
from rearticulate.report.html import Score, write_report
from rearticulate.report.summary import jsonable, result_as_dict


@dataclasses.dataclass(frozen=True)
class FitOptions(Settings):
    """What the command line says about a fit."""

    preset: str = "direct"
    config: Path | None = None
    canonical: str = "auto"
    seed: Seed = 0
    device: str = "auto"
    resume: bool = False
    overwrite: bool = False
    report: bool = True

    def resolve(self) -> FitConfig:
        """The configuration: a preset, changed by the file. Raises InputError where the device has no use or is not
        there."""
        from rearticulate.methods.device import choose_device

        base = preset(self.preset)
        config = base if self.config is None else load_config(self.config, base)
        choose_device(self.device, config)
        return config

    def canonical_frame(self) -> int | None:
        """The frame asked for; None for auto."""
        if self.canonical == "auto":
            return None
        if not (self.canonical.isascii() and self.canonical.isdecimal()):
            raise InputError(f"--canonical must be 'auto' or the number of a frame, not {self.canonical!r}")
        return int(self.canonical)


def run_fit(source: str, out: Path, options: FitOptions, given: InputOptions, as_json: bool) -> None:
    """The command `fit`."""
    config, canonical = options.resolve(), options.canonical_frame()
    with reserve(out):
        finished = options.resume and not options.overwrite and (out / "model.json").exists()
        if not finished:
            check_output(out, overwrite=options.overwrite)
        sequence = load_sequence(source, **given.keywords(), seed=options.seed)
        if given.scale == 1.0:
            warn_of_unit(sequence)
        if finished:
            result = _finished(out, sequence, config, canonical, options.seed)
            with reserve(out / REPORT) as last:
                if options.report and not last.exists():
                    write_extras(out, result, sequence, None)
        else:
            result = fit_with_progress(sequence, config, canonical, out, options)
            write_result(out, result, sequence, None, options)
    if as_json:
        print_json({"out": str(out), "frame_names": sequence.names, **result_as_dict(result, sequence)})
        return
    show_result(result, sequence)
    show_facts({"order": describe_order(sequence.names)})
    print(_written(out))


def run_demo(name: str | None, out: Path, as_json: bool) -> None:
    """The command `demo`: fit a bundled sequence, compare with ground truth, replace an earlier demo."""
    from rearticulate.evaluation.metrics import canonical_labels, evaluate
    from rearticulate.io.truth import load_truth
    from rearticulate.synth import bundled

    name = name or bundled.names()[0]
    if name not in bundled.names():
        raise InputError(f"there is no bundled sequence {name!r}; there are {', '.join(bundled.names())}")
    options = FitOptions(overwrite=True)
    with reserve(out):
        check_output(out, overwrite=True)
        sequence = load_sequence(bundled.path(name))
        result = fit_with_progress(sequence, options.resolve(), None, out, options)
        truth = load_truth(bundled.truth_path(name))
        metrics = evaluate(result, truth, sequence)
        write_result(out, result, sequence, Score(metrics, canonical_labels(result, truth, sequence)), options)
    if as_json:
        print_json({"out": str(out), **result_as_dict(result, sequence), "metrics": {m.key: m.value for m in metrics}})
        return
    show_result(result, sequence)
    show_metrics(metrics)
    print(_written(out))


def fit_with_progress(
    sequence: PointSequence, config: FitConfig, canonical: int | None, out: Path, options: FitOptions
) -> FitResult:
    """Fit, stage records in OUT/stages; without --resume those of an earlier run go first."""
    from rearticulate.pipeline import fit

    stages = out / "stages"
    if not options.resume:
        shutil.rmtree(stages, ignore_errors=True)
    try:
        with StageProgress() as progress:
            store = StageStore(stages)
            return fit(
                sequence,
                config,
                seed=options.seed,
                canonical=canonical,
                progress=progress,
                store=store,
                device=options.device,
            )
    except KeyboardInterrupt:
        kept = stages.is_dir() and any(stages.iterdir())
        raise KeyboardInterrupt("interrupted" + ("; --resume goes on from here" if kept else "")) from None


def write_result(
    out: Path,
    result: FitResult,
    sequence: PointSequence,
    score: Score | None,
    options: FitOptions,
    extra: Callable[[Path], None] | None = None,
) -> None:
    """The whole folder at once, what `extra` writes included; then, where they are wanted, report and pictures."""
    save_result(out, result, sequence, overwrite=options.overwrite, extra=extra)
    if options.report:
        write_extras(out, result, sequence, score)


def write_extras(out: Path, result: FitResult, sequence: PointSequence, score: Score | None) -> None:
    """Pictures and, last, the report into the folder of a result, which is as good without: what fails is said."""
    from rearticulate.render.stills import write_pictures

    try:
        write_pictures(out, result, sequence)
        write_report(out, result, sequence, score, title=out.resolve().name)
    except (FitError, OSError, MemoryError) as error:
        say(f"warning: {str(error) or type(error).__name__}; the result is complete without it")


def _finished(out: Path, sequence: PointSequence, config: FitConfig, canonical: int | None, seed: int) -> FitResult:
    """The result that is there already, if it was made from the same points with the same settings."""
    result, fitted = load_result(out), load_sequence_of(out)
    other = "; ask for --overwrite or name another folder"
    if (
        result.seed != seed
        or jsonable(result.config) != jsonable(dataclasses.asdict(config))
        or canonical not in (None, result.model.canonical)
    ):
        raise InputError(f"{out}: holds a result made with other settings{other}")
    if len(sequence) != len(fitted) or not all(map(np.array_equal, sequence.points, fitted.points)):
        raise InputError(f"{out}: holds the result of another sequence{other}")
    say(f"{out}: complete already, nothing to resume")
    return result


def _written(out: Path) -> str:
    report = out / REPORT
    return f"report  {report}" if report.exists() else f"result  {out}"
