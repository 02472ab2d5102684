"""CPU time and error of several ways to do the work of a stage, and their table and picture."""

import math
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from startrack import metrics, plots

Way = Callable[[], Any]

ROUNDS = 5
ENOUGH = 6.0  # second of CPU of a stage; later, no round begins; chosen by hand


class Clocked(NamedTuple):
    """The answer of a way that works in another process, and its CPU time there."""

    answer: Any
    seconds: float


@dataclass(frozen=True)
class BenchmarkStage:
    """One task, and how its answers are judged.

    work      description of the work, as text
    error     meaning of the error, with its unit
    ways      name -> the whole work; returns an answer
    judge     an answer -> its error
    limit     lower bound of the error; NaN where unknown
    limit_of  origin of the limit
    pieces    number in one call; times are for one piece
    missing   reason why some ways of startrack are left out; may be empty
    """

    name: str
    work: str
    error: str
    ways: Mapping[str, Way]
    judge: Callable[[Any], float]
    limit: float = math.nan
    limit_of: str = ""
    pieces: int = 1
    missing: str = ""


class StageRow(NamedTuple):
    """One way through one stage.

    seconds  of CPU for a piece of work, the least of several rounds
    """

    stage: str
    way: str
    peer: bool
    seconds: float
    error: float


def measure(
    stage: BenchmarkStage, peers: Mapping[str, Way] | None = None, rounds: int = ROUNDS
) -> list[StageRow]:
    """Measure every way of a stage, of startrack and of the peers, on the same work in turns.

    The first call of each fills caches, and its answer is judged; the result is the smallest time
    of the later ones.
    """
    ways = {**stage.ways, **(peers or {})}
    least, errors = dict.fromkeys(ways, math.inf), dict[str, float]()
    for name, way in ways.items():
        errors[name] = stage.judge(clocked(way).answer)
    began = time.process_time()
    for number in range(rounds):
        if number and time.process_time() - began > ENOUGH:
            break
        for name, way in ways.items():
            least[name] = min(least[name], clocked(way).seconds)
    return [
        StageRow(stage.name, name, name not in stage.ways, least[name] / stage.pieces, errors[name])
        for name in ways
    ]


def clocked(way: Way) -> Clocked:
    """The result of one program, and its CPU time in seconds."""
    began = time.process_time()
    answer = way()
    if isinstance(answer, Clocked):
        return answer
    return Clocked(answer, time.process_time() - began)


PACKAGES = ("startrack", "numpy", "scipy", "numba", "opencv-contrib-python-headless")
UNITS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))


def markdown(stages: Sequence[BenchmarkStage], rows: Sequence[StageRow]) -> str:
    """One table a stage; ways of startrack are bold."""
    text = []
    for stage in stages:
        limit = f", limit {figure(stage.limit)} ({stage.limit_of})" if stage.limit_of else ""
        text += [f"## {stage.name}", f"{stage.work}; error: {stage.error}{limit}.", ""]
        columns = [
            metrics.Column("", "way", lambda row: row.way if row.peer else f"**{row.way}**"),
            metrics.Column("", "CPU time", lambda row: spent(row.seconds)),
            metrics.Column("", "error", lambda row: figure(row.error)),
        ]
        mine = [row for row in rows if row.stage == stage.name]
        text += metrics.Table(columns, mine).markdown()
        text += ["", *([f"Left out: {stage.missing}.", ""] if stage.missing else [])]
    return "\n".join(text)


def values(stages: Sequence[BenchmarkStage], rows: Sequence[StageRow]) -> dict[str, Any]:
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
    """Python, processor and installed packages of this run."""
    names = [f"Python {platform.python_version()}", platform.machine()]
    for package in (*PACKAGES, *packages):
        try:
            names.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(names)


def figure(value: float) -> str:
    """Two digits; `-` for unknown values."""
    return f"{value:.2g}" if math.isfinite(value) else "-"


def spent(seconds: float) -> str:
    """Three digits in a suitable unit."""
    unit, size = next((u for u in UNITS if seconds >= u[1]), UNITS[-1])
    return f"{seconds / size:.3g} {unit}"


LINE, HEAD = 0.24, 1.0  # inch, of a way and of the rest of a stage
ROOM = 0.8  # decades, and a third of the range, to the right of the points, for their numbers


@plots.styled
def draw_benchmark(path: Path, stages: Sequence[BenchmarkStage], rows: Sequence[StageRow]) -> None:
    """A row for each way of each stage: its CPU time and its error, with their numbers."""
    counts = [max(1, sum(row.stage == stage.name for row in rows)) for stage in stages]
    heights = [HEAD + LINE * count for count in counts]
    drawn = plots.picture(
        0.5 + sum(heights),
        "CPU time of one thread, and error; circles: startrack, squares: other programs; dashed: "
        "lower bound of the error",
    )
    panels = drawn.subplots(len(stages), 2, squeeze=False, height_ratios=heights)
    for (times, errors), stage in zip(panels, stages, strict=True):
        mine = [row for row in rows if row.stage == stage.name]
        _points(times, mine, [1e3 * row.seconds for row in mine], [spent(r.seconds) for r in mine])
        times.set_yticks(range(len(mine)), [row.way for row in mine])
        times.set_xlabel("CPU time of a piece (ms)")
        plots.panel_title(times, stage.name)
        _points(
            errors,
            mine,
            [row.error for row in mine],
            [figure(row.error) for row in mine],
            stage.limit,
        )
        errors.set_yticks(range(len(mine)), [""] * len(mine))
        errors.set_xlabel(fill(stage.error, 38))
        if math.isfinite(stage.limit) and stage.limit > 0:
            errors.axvline(stage.limit, color=plots.BLACK, lw=1, ls="--")
            plots.panel_title(errors, f"bound: {stage.limit_of}", 40)
    plots.save_picture(path, drawn)


def _points(
    axes: Axes,
    rows: Sequence[StageRow],
    values: Sequence[float],
    texts: Sequence[str],
    limit: float = math.nan,
) -> None:
    """Points from top to bottom, with their numbers; a value of zero stands at the left edge."""
    positive = [value for value in values if math.isfinite(value) and value > 0]
    positive += [limit] if math.isfinite(limit) and limit > 0 else []
    low, high = min(positive, default=1.0), max(positive, default=1.0)
    for k, (row, value, text) in enumerate(zip(rows, values, texts, strict=True)):
        at = value if math.isfinite(value) and value > 0 else low / 3
        if math.isfinite(value):
            look = ("s", plots.PURPLE) if row.peer else ("o", plots.GREEN)
            axes.plot(at, k, look[0], ms=5.5, color=look[1])
        plots.note(axes, text if math.isfinite(value) else "not known", (at, k), (6, 0))
    room = 10**ROOM * (high / low) ** 0.35
    axes.set(xscale="log", xlim=(low / 5, high * room))
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
