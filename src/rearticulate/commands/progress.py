"""The progress of a fit on stderr: a bar a stage in a terminal, a line a stage elsewhere."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn
from rich.text import Text

from rearticulate.commands.outcome import say


class StageProgress:
    """Called with a stage and the share of it that is done. A stage may come back, its time adds up."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._tasks: dict[str, TaskID] = {}
        self._stage, self._last = "", time.perf_counter()
        console = Console(stderr=True)
        columns = SpinnerColumn(finished_text="✓"), TextColumn("{task.description}"), BarColumn(28), _Seconds(self)
        self._bars = Progress(*columns, console=console) if console.is_terminal else None

    def __enter__(self) -> StageProgress:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, stage: str, fraction: float) -> None:
        self._seconds[self._stage], self._last = self.seconds(self._stage), time.perf_counter()
        self._stage = stage
        if self._bars is None:
            self._announce(stage)
            return
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=1.0)
        self._bars.update(self._tasks[stage], completed=fraction)

    def seconds(self, stage: str) -> float:
        """Time spent in a stage so far."""
        running = time.perf_counter() - self._last if stage == self._stage else 0.0
        return self._seconds.get(stage, 0.0) + running

    def _announce(self, stage: str) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = TaskID(len(self._tasks))
            say(f"{stage} ...")


class _Seconds(ProgressColumn):
    def __init__(self, stages: StageProgress) -> None:
        super().__init__()
        self._stages = stages

    def render(self, task: Task) -> Text:
        return Text(f"{self._stages.seconds(task.description):5.1f} s", style="progress.elapsed")
