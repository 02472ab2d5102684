"""Pictures of sweeps: errors and margins over keys, and the values that just keep a limit."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize, TwoSlopeNorm

from startrack.core import Floats, arcsec
from startrack.metrics import Interval
from startrack.optimise import Figure, ProblemSweep, Solution, Sweep, middle
from startrack.plots import style

MOST_MARGINS = len(style.CYCLE)  # the least ones are drawn; the table has all
LEAST, MOST = -1.0, 1.0  # margins that are drawn; chosen by hand
MOST_TICKS, LONGEST = 9, 12  # values beside an axis; letters of one
WRITTEN = 12  # largest number of columns and rows of a map whose cells have numbers


@style.styled
def draw_sweep(path: Path, swept: Sweep, title: str) -> None:
    """Errors with their limits, and margins, at each value of one or two keys."""
    figure = style.picture(8.0, f"{title}, by {swept.how}\n{swept.answer}")
    panels = figure.subplots(2 if swept.asked else 1, 1, squeeze=False)[:, 0]
    if len(swept.keys) == 1:
        _draw_errors(panels[0], swept)
        if swept.asked:
            _draw_margins(panels[1], swept)
    else:
        error = _grid(swept, [middle(row.figure("across")) / arcsec for row in swept.rows])
        positive = error[error > 0]
        scale = LogNorm(*style.colour_limits(positive)) if len(positive) else Normalize(0, 1)
        _draw_map(panels[0], swept, error, "error across (arcsec rms per axis)", scale, "viridis_r")
        if swept.asked:
            least = _grid(swept, [row.least_margin[1] for row in swept.rows])
            size = style.robust_limit(least)
            label = "least margin (below 0: not met)"
            _draw_map(panels[1], swept, least, label, TwoSlopeNorm(0, -size, size), "PuOr")
    style.save_picture(path, figure)


@style.styled
def draw_problem_sweep(path: Path, swept: ProblemSweep, title: str) -> None:
    """The objective of a problem and its margins at each value of one or two keys."""
    figure = style.picture(8.0, f"{title}, by {swept.how}\n{swept.answer}")
    label = style.with_unit(swept.words.value, swept.words.unit)
    values = [row.value for row in swept.rows]
    if len(swept.keys) == 2:
        axes = figure.subplots()
        numbers = _grid(swept, list(map(middle, values)))
        _draw_map(
            axes, swept, numbers, label, Normalize(*style.colour_limits(numbers)), "viridis_r"
        )
        style.save_picture(path, figure)
        return
    upper, lower = figure.subplots(2, 1)
    _draw_line(upper, _places(swept, upper), values, 1.0, 0, swept.words.value)
    upper.set_ylabel(label)
    at = _places(swept, lower)
    names = dict.fromkeys(name for row in swept.rows for name in row.margins)
    for n, name in enumerate(list(names)[:MOST_MARGINS]):
        margins = [row.margins.get(name, np.nan) for row in swept.rows]
        _draw_line(lower, at, margins, 1.0, n, name)
    lower.axhline(0, color=style.BLACK, lw=1.2)
    low, high = lower.get_ylim()
    lower.set_ylim(max(low, LEAST), min(high, MOST))
    lower.set_ylabel("margin (fraction of limit)")
    style.panel_title(lower, "below 0: not met")
    style.legend_below(lower, 3)
    style.save_picture(path, figure)


@style.styled
def draw_crossings(path: Path, solution: Solution, title: str) -> None:
    """The margin by formula over the key, and the values at which it is zero."""
    figure = style.picture(4.6, f"{title}, by {solution.how}\n{solution.answer}")
    axes, numbers = figure.subplots(), np.array(list(solution.margins))
    axes.plot(
        numbers, list(solution.margins.values()), "o-", ms=3.5, color=style.BLUE, label="by formula"
    )
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, LEAST), min(high, MOST))
    axes.axhline(0, color=style.BLACK, lw=1.2)
    for n, crossing in enumerate(solution.crossings):
        label = None if n else "just kept, with the interval of 95 % by trials"
        if isinstance(crossing.value, Interval):
            bars = np.nan_to_num(style.bars_of(crossing.value), posinf=0.0)
            axes.errorbar(
                crossing.value.value,
                0,
                xerr=bars,
                fmt="s",
                ms=4,
                capsize=5,
                color=style.RED,
                label=label,
            )
        else:
            axes.plot(crossing.value, 0, "s", ms=6, color=style.RED, label="just kept, by formula")
    if (numbers > 0).all() and numbers.max() / numbers.min() > 9:
        axes.set_xscale("log")
    axes.set(xlabel=solution.key.label, ylabel=f"margin: {solution.margin}")
    style.legend_below(axes, 2)
    style.save_picture(path, figure)


def _places(swept: Sweep | ProblemSweep, axes: Axes) -> Floats:
    """Places of the rows along the x axis; labels the axis and, for words, its ticks."""
    [key] = swept.keys
    axes.set_xlabel(key.label)
    if key.numbers is None:
        axes.set_xticks(range(len(key.texts)), [_short(text) for text in key.texts])
        if max(map(len, key.texts)) * len(key.texts) > style.LETTERS // 2:
            axes.tick_params(axis="x", rotation=30)
        return np.arange(len(key.texts), dtype=float)
    numbers = np.array(key.numbers)
    if (numbers > 0).all() and numbers.max() / numbers.min() > 9:
        axes.set_xscale("log")
    return numbers


def _draw_line(
    axes: Axes, at: Floats, figures: Sequence[Figure], unit: float, n: int, name: str
) -> None:
    """A figure over the values, with intervals where it has them."""
    look = {"color": style.CYCLE[n], "marker": style.MARKERS[n], "ms": 4.5, "label": name}
    order = np.argsort(at)
    every = [
        figure if isinstance(figure, Interval) else Interval(figure, np.nan, np.nan)
        for figure in figures
    ]
    style.draw_intervals(
        axes, at[order], [every[k] for k in order], unit, ls=style.LINES[n], **look
    )


def _draw_errors(axes: Axes, swept: Sweep) -> None:
    at = _places(swept, axes)
    limits = {limit.name: limit for limit in swept.limits if limit.objective.rms_per_axis}
    for n, (name, words) in enumerate(
        (("across", "across the boresight, rms per axis"), ("about", "about the boresight, rms"))
    ):
        figures = [row.figure(name) for row in swept.rows]
        _draw_line(axes, at, figures, arcsec, n, words)
        if name in limits:
            most = limits[name].most / arcsec
            text = f"limit {name}, {most:g} arcsec"
            axes.axhline(most, color=style.CYCLE[n], ls=":", lw=1.5, label=text)
    missing = [n for n, row in enumerate(swept.rows) if not middle(row.figure("across")) > 0]
    if missing:
        axes.plot(
            at[missing],
            np.full(len(missing), 0.03),
            "x",
            color=style.GREY,
            transform=axes.get_xaxis_transform(),
            label=f"refused, or no attitude ({len(missing)})",
        )
    if len(missing) < len(swept.rows):
        axes.set_yscale("log")
    axes.set_ylabel("error (arcsec)")
    style.legend_below(axes, 2)


def _draw_margins(axes: Axes, swept: Sweep) -> None:
    at = _places(swept, axes)
    columns = {name: [row.margin(name) for row in swept.rows] for name in swept.margins}
    least = {
        name: min((m for m in map(middle, some) if np.isfinite(m)), default=MOST)
        for name, some in columns.items()
    }
    near = sorted((name for name in least if least[name] < MOST), key=least.__getitem__)
    shown = [name for name in columns if name in near[:MOST_MARGINS]]
    for n, name in enumerate(shown):
        _draw_line(axes, at, columns[name], 1.0, n, name)
    axes.axhline(0, color=style.BLACK, lw=1.2)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, LEAST), min(high, MOST))
    axes.axhspan(LEAST, 0, color=style.RED, alpha=0.08, lw=0)
    axes.set_ylabel("margin (fraction of limit; stars: mag)")
    more = "; larger margins are in sweep.csv alone" if len(shown) < len(columns) else ""
    style.panel_title(axes, f"below 0: not met{more}")
    style.legend_below(axes, 3)


def _grid(swept: Sweep | ProblemSweep, values: Sequence[float]) -> Floats:
    """Values of the rows as an array over first key and last key."""
    return np.array(values, float).reshape([len(key.texts) for key in swept.keys])


def _draw_map(
    axes: Axes,
    swept: Sweep | ProblemSweep,
    values: Floats,
    label: str,
    scale: Normalize,
    colours: str,
) -> None:
    colour_map = matplotlib.colormaps[colours].copy()
    colour_map.set_bad(style.NO_VALUE)
    drawn = axes.imshow(values, colour_map, scale, aspect="auto", origin="lower")
    axes.grid(visible=False)
    rows, columns = swept.keys
    for axis, key in ((axes.xaxis, columns), (axes.yaxis, rows)):
        step = -(-len(key.texts) // MOST_TICKS)
        at = range(0, len(key.texts), step)
        axis.set_ticks(at, [_short(_number(key.texts[n], key.unit)) for n in at])
        axis.set_label_text(key.label)
    if max(values.shape) <= WRITTEN:
        for (y, x), value in np.ndenumerate(values):
            text = style.number(value) if np.isfinite(value) else "none"
            style.note(axes, text, (x, y), (0, 0), ha="center")
    style.colour_bar(drawn, axes, values, label)


def _number(text: str, unit: str) -> str:
    """A value in four digits, without its unit, which the axis has."""
    bare = text.removesuffix(unit).strip() if unit else text
    try:
        return f"{float(bare):.4g}"
    except ValueError:
        return bare


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
