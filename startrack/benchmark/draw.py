"""Rows of stages -> one picture: time across, error up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from startrack.benchmark.stage import Row, Stage
from startrack.saving import whole

OURS, PEER, LIMIT = "#1f6f43", "#8a5a9e", "#b4442f"
ACROSS = 3


def draw_benchmark(path: Path, stages: Sequence[Stage], rows: Sequence[Row]) -> None:
    """One panel a stage; below and left is better, the line is what nothing can beat."""
    down = math.ceil(len(stages) / ACROSS)
    figure = Figure(figsize=(4.3 * ACROSS, 3.1 * down), layout="constrained")
    for n, stage in enumerate(stages):
        axes = figure.add_subplot(down, ACROSS, n + 1)
        _panel(axes, stage, [row for row in rows if row.stage == stage.name])
    figure.suptitle("CPU time of one thread against error: startrack green, others violet")
    with whole(path) as draft:
        figure.savefig(draft, dpi=110)


def _panel(axes: Axes, stage: Stage, rows: Sequence[Row]) -> None:
    limit = stage.limit if math.isfinite(stage.limit) and stage.limit > 0 else math.nan
    known = [row.error for row in rows if math.isfinite(row.error) and row.error > 0]
    floor = min([*known, limit] if math.isfinite(limit) else known, default=1.0) / 3
    for row in rows:
        if not math.isfinite(row.error):
            continue
        colour = PEER if row.peer else OURS
        # No error at all is drawn at the foot of the panel.
        at = (1e3 * row.seconds, max(row.error, floor))
        axes.plot(*at, "s" if row.peer else "o", color=colour, ms=5)
        axes.annotate(row.way, at, (4, 3), textcoords="offset points", fontsize=7, color=colour)
    if math.isfinite(limit):
        axes.axhline(limit, color=LIMIT, lw=1, ls="--")
        axes.annotate(
            stage.limit_of, (0.02, limit), xycoords=("axes fraction", "data"), fontsize=6.5,
            xytext=(0, 2), textcoords="offset points", color=LIMIT,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", title=stage.name)
    axes.set_xlabel("CPU time of a piece (ms)", fontsize=8)
    axes.set_ylabel(_folded(stage.error), fontsize=7)
    axes.margins(x=0.3, y=0.15)
    axes.tick_params(labelsize=7)
    axes.grid(lw=0.3, which="major")


def _folded(text: str, width: int = 38) -> str:
    lines = [""]
    for word in text.split():
        lines = [*lines[:-1], f"{lines[-1]} {word}".strip()] if len(lines[-1]) < width else [
            *lines, word
        ]  # fmt: skip
    return "\n".join(lines)
