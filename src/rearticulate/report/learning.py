"""The learning curve of a training run as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rearticulate.io.atomic import atomic_file


def draw_learning_curve(history: Sequence[dict[str, float]], path: Path) -> None:
    """Loss on the pairs trained on and on unseen ones, and the median matching error, against the steps."""
    from matplotlib.figure import Figure

    steps = [note["step"] for note in history]
    figure = Figure(figsize=(8, 3), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(steps, [note["loss"] for note in history], label="trained on", color="#4c78a8")
    left.plot(steps, [note["validation_loss"] for note in history], label="unseen", color="#e4572e")
    left.set(xlabel="step", ylabel="cross-entropy")
    left.legend(frameon=False)
    right.plot(steps, [100 * note["median_error"] for note in history], color="#e4572e")
    right.set(xlabel="step", ylabel="median error, % of rms radius", ylim=(0, None))
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    with atomic_file(path) as partial:
        figure.savefig(partial, format="png", dpi=130)
