"""Curves of a training as a picture."""

from __future__ import annotations

from pathlib import Path

from lfdepth.io.atomic import atomic
from lfdepth.training.loop import HEADINGS, Training


def draw_curves(trained: Training, folder: Path) -> Path:
    """Write curves.png: the loss, and the bad pixels of the validation scenes, over the steps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    loss, bad = figure.subplots(1, 2)
    steps = [row[0] for row in trained.rows]
    loss.plot(steps, [row[1] for row in trained.rows], label="training")
    loss.plot(steps, [row[5] for row in trained.rows], label="validation")
    loss.set(title="mean absolute error", xlabel="step", ylabel="px per view step", yscale="log")
    for i in (2, 3, 4):
        bad.plot(steps, [row[i] for row in trained.rows], label=HEADINGS[i].replace("badpix_", ""))
    bad.set(title="bad pixels of the validation scenes", xlabel="step", ylabel="%", ylim=(0, 100))
    for axes in (loss, bad):
        axes.legend()
        axes.grid(alpha=0.3)
    path = folder / "curves.png"
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})
    return path
