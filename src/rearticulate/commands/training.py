"""`train-flow`: trains the correspondence network."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from rearticulate.bounds import Count, CountOrZero, Seed, Settings
from rearticulate.commands.outcome import say
from rearticulate.errors import InputError
from rearticulate.extras import needs
from rearticulate.io.atomic import reserve


@dataclass(frozen=True)
class TrainOptions(Settings):
    """What the command line says about a training run."""

    steps: Count
    seed: Seed
    device: str
    mixed: bool | None
    workers: CountOrZero
    resume: bool
    overwrite: bool


def run_train(out: Path, options: TrainOptions) -> None:
    """The command `train-flow`; under torchrun every process runs it."""
    config, run = _open(out, options)
    first, alone = run.step, nullcontext() if run.rank else reserve(out)
    with alone, Steps(config.steps, first, silent=run.rank > 0) as steps:
        if run.rank == 0:
            say(f"training on {run.device} from step {first} to {config.steps}, {run.world} process(es)")
        run.train(steps, options.workers)
        run.close()
        if run.rank == 0:
            _keep(out, run, config.seed)


def _keep(out: Path, run: Any, seed: int) -> None:
    from rearticulate.report.learning import draw_learning_curve
    from rearticulate.training.weights import save_network

    weights, picture = out / "correspondence.safetensors", out / "learning.png"
    save_network(weights, run.net, {"steps": run.step, "seed": seed})
    draw_learning_curve(run.history, picture)
    print(f"weights   {weights}\ncurve     {picture}")


def _open(out: Path, options: TrainOptions) -> tuple[Any, Any]:
    with needs("train"):
        from rearticulate.training.train import Run, TrainConfig, choose_device
    if out.exists() and not (options.resume or options.overwrite):
        raise InputError(f"{out}: exists; go on with --resume or start again with --overwrite")
    device = choose_device(options.device)
    mixed = device.type == "cuda" if options.mixed is None else options.mixed
    config = TrainConfig(steps=options.steps, seed=options.seed, mixed=mixed)
    return config, Run(config, out, device, options.resume)


class Steps:
    """The progress of a run: a bar in a terminal, a line every now and then elsewhere."""

    EVERY = 100

    def __init__(self, total: int, first: int, silent: bool) -> None:
        console = Console(stderr=True)
        columns = TextColumn("loss {task.fields[loss]:.3f}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        self._bar = Progress(*columns, console=console) if console.is_terminal and not silent else None
        self._task = self._bar.add_task("", total=total, completed=first, loss=0.0) if self._bar else None
        self._total, self._silent = total, silent

    def __enter__(self) -> Steps:
        if self._bar:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def __call__(self, step: int, loss: float) -> None:
        if self._bar and self._task is not None:
            self._bar.update(self._task, completed=step, loss=loss)
        elif not self._silent and step % self.EVERY == 0:
            say(f"step {step} of {self._total}: loss {loss:.3f}")
