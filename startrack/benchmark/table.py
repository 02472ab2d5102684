"""Markdown, plain values and a picture of the rows of stages."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from startrack.benchmark.stage import Row, Stage
from startrack.io import save_figure

PACKAGES = ("startrack", "numpy", "scipy", "numba", "opencv-contrib-python-headless")
UNITS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))


def markdown(stages: Sequence[Stage], rows: Sequence[Row]) -> str:
    """One table a stage; ways of startrack are bold."""
    text = []
    for stage in stages:
        limit = f", limit {figure(stage.limit)} ({stage.limit_of})" if stage.limit_of else ""
        text += [f"### {stage.name}", f"{stage.work}; error: {stage.error}{limit}.", ""]
        text += ["| way | CPU time | error |", "|---|---|---|"]
        for row in rows:
            if row.stage == stage.name:
                way = row.way if row.peer else f"**{row.way}**"
                text.append(f"| {way} | {spent(row.seconds)} | {figure(row.error)} |")
        text += ["", *([f"Left out: {stage.missing}.", ""] if stage.missing else [])]
    return "\n".join(text)


def values(stages: Sequence[Stage], rows: Sequence[Row]) -> dict[str, Any]:
    """The results as plain values; times in seconds."""
    return {
        stage.name: {
            "work": stage.work,
            "error": stage.error,
            "limit": stage.limit,
            "limit_of": stage.limit_of,
            "missing": stage.missing,
            "ways": {
                row.way: {"seconds": row.seconds, "error": row.error, "peer": row.peer}
                for row in rows
                if row.stage == stage.name
            },
        }
        for stage in stages
    }


def versions(packages: Sequence[str] = ()) -> str:
    """Python, processor and packages of this run; those that are not installed are left out."""
    found = [f"Python {platform.python_version()}", platform.machine()]
    for package in (*PACKAGES, *packages):
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def figure(value: float) -> str:
    """Two digits; `-` for unknown values."""
    return f"{value:.2g}" if math.isfinite(value) else "-"


def spent(seconds: float) -> str:
    """Three digits in a suitable unit."""
    unit, size = next((u for u in UNITS if seconds >= u[1]), UNITS[-1])
    return f"{seconds / size:.3g} {unit}"


OURS, PEER, LIMIT = "#1f6f43", "#8a5a9e", "#b4442f"
ACROSS = 3


def draw_benchmark(path: Path, stages: Sequence[Stage], rows: Sequence[Row]) -> None:
    """One panel a stage; lower left is better, the line is the lower bound of the error."""
    down = math.ceil(len(stages) / ACROSS)
    figure = Figure(figsize=(4.3 * ACROSS, 3.1 * down), layout="constrained", dpi=110)
    for n, stage in enumerate(stages):
        axes = figure.add_subplot(down, ACROSS, n + 1)
        _panel(axes, stage, [row for row in rows if row.stage == stage.name])
    figure.suptitle("CPU time of one thread against error: startrack green, others violet")
    save_figure(path, figure)


def _panel(axes: Axes, stage: Stage, rows: Sequence[Row]) -> None:
    rows = [row for row in rows if math.isfinite(row.error)]
    limit = stage.limit if math.isfinite(stage.limit) and stage.limit > 0 else math.nan
    known = [row.error for row in rows if row.error > 0]
    known += [limit] * math.isfinite(limit)
    # An error of zero is drawn at the lower edge of the panel.
    points = [(1e3 * row.seconds, row.error or min(known, default=1.0) / 3) for row in rows]
    axes.set(xscale="log", yscale="log", title=stage.name)
    first, last = _span([x for x, _ in points])
    axes.set_xlim(first, last * 10 ** (0.3 * math.log10(last / first)))  # room for names
    axes.set_ylim(*_span([y for _, y in points] + known))
    for row, point in zip(rows, points, strict=True):
        axes.plot(*point, "s" if row.peer else "o", color=PEER if row.peer else OURS, ms=5)
    _name(axes, rows, points)
    if math.isfinite(limit):
        axes.axhline(limit, color=LIMIT, lw=1, ls="--")
        axes.annotate(
            stage.limit_of, (0.02, limit), xycoords=("axes fraction", "data"), fontsize=6.5,
            xytext=(0, -8), textcoords="offset points", color=LIMIT,
        )  # fmt: skip
    axes.set_xlabel("CPU time of a piece (ms)", fontsize=8)
    axes.set_ylabel(_folded(stage.error), fontsize=7)
    axes.tick_params(labelsize=7)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    axes.grid(lw=0.3, which="major")


def _span(values: Sequence[float]) -> tuple[float, float]:
    """Whole decades around some values, with half a decade to spare."""
    return (
        10 ** math.floor(math.log10(min(values, default=1.0)) - 0.5),
        10 ** math.ceil(math.log10(max(values, default=1.0)) + 0.5),
    )


def _name(axes: Axes, rows: Sequence[Row], points: Sequence[tuple[float, float]]) -> None:
    """Names to the right of the points, stacked where points are close."""
    named: list[tuple[float, float]] = []
    for row, point in zip(rows, points, strict=True):
        x, y = axes.transAxes.inverted().transform(axes.transData.transform(point))
        above = sum(abs(x - u) < 0.25 and abs(y - v) < 0.05 for u, v in named)
        named.append((x, y))
        axes.annotate(
            row.way, point, (4, 3 + 8 * above), textcoords="offset points", fontsize=7,
            color=PEER if row.peer else OURS,
        )  # fmt: skip


def _folded(text: str, width: int = 38) -> str:
    lines = [""]
    for word in text.split():
        lines = [*lines[:-1], f"{lines[-1]} {word}".strip()] if len(lines[-1]) < width else [
            *lines, word
        ]  # fmt: skip
    return "\n".join(lines)
