"""One look for all pictures: their size, letters, colours and numbers, and how they are saved.

A picture is 1280 pixels wide. Its letters stay legible on a phone, which shows it in 400.
"""

import math
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from textwrap import fill
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import ScaledTranslation
from numpy.typing import ArrayLike

from startrack.core import Floats
from startrack.io import save_figure
from startrack.metrics import Interval

# Colours that readers who confuse red and green tell apart, too. Source: Okabe and Ito (2008),
# Color Universal Design.
BLACK, GREY = "#000000", "#777777"
BLUE, SKY, GREEN = "#0072b2", "#56b4e9", "#009e73"
RED, ORANGE, YELLOW, PURPLE = "#d55e00", "#e69f00", "#f0e442", "#cc79a7"
CYCLE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY, BLACK)
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

WIDE, DPI = 6.4, 200  # inch, pixel / inch
SMALL = 8.5  # point; the smallest letters, which have 7 pixels where the picture is 400 wide
LETTERS = 82  # of a title's line
SETTINGS: Any = {
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-99, 99),  # no power of ten beside the axis
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=CYCLE),
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "image.cmap": "viridis",
}
NARROWEST = 0.01  # relative range of colours; less would show rounding
NO_VALUE = "0.75"  # grey of a map where there is none

P = ParamSpec("P")
R = TypeVar("R")


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Draw in this look; the caller's own settings for pictures stay as they were."""

    @wraps(draw)
    def drawn(*given: P.args, **named: P.kwargs) -> R:
        with matplotlib.rc_context(SETTINGS):
            return draw(*given, **named)

    return drawn


def picture(high: float, title: str = "") -> Figure:
    """An empty picture.

    high   inch
    title  plain text, folded at the picture's width
    """
    figure = Figure(figsize=(WIDE, high), dpi=DPI, layout="constrained")
    if title:
        figure.suptitle(_folded(title), fontsize=10, x=0.01, ha="left")
    return figure


def lines_of(title: str) -> int:
    """Number of lines that a title has after `picture` folds it."""
    return len(_folded(title).splitlines())


def _folded(title: str) -> str:
    return "\n".join(fill(line, LETTERS) for line in title.splitlines())


def panel_title(axes: Axes, text: str, letters: int = LETTERS) -> None:
    """A title above a panel, folded at a number of letters."""
    axes.set_title(fill(text, letters))


def legend_below(axes: Axes, columns: int = 3, labels: bool = True) -> None:
    """Put the legend below a panel, where it hides nothing.

    labels  whether numbers and label of the x axis are between panel and legend
    """
    figure = axes.figure
    assert isinstance(figure, Figure)
    down = ScaledTranslation(0, -(36 if labels else 5) / 72, figure.dpi_scale_trans)
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(-0.02, 0.0),
        bbox_transform=axes.transAxes + down,
        ncols=columns,
        borderaxespad=0,
        columnspacing=1.2,
        handlelength=2.2,
    )


def draw_intervals(
    axes: Axes, at: ArrayLike, intervals: Sequence[Interval], unit: float, **look: Any
) -> None:
    """Values at places, with the bars of their intervals; none where an end is not finite."""
    value, low, high = (
        np.array([getattr(interval, part) for interval in intervals]) / unit
        for part in ("value", "low", "high")
    )
    bars = [np.where(np.isfinite(end), end, 0) for end in (value - low, high - value)]
    axes.errorbar(at, value, yerr=bars, **look)


def colour_limits(
    values: ArrayLike, part: float = 1.0, low: float | None = None
) -> tuple[float, float]:
    """Limits of colours that hold a part of the values, farther apart than rounding errors.

    part  fraction of the values that do not exceed the upper limit
    low   the lower limit; None: the least value
    """
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return 0.0, 1.0
    first = float(finite.min()) if low is None else low
    last = float(np.quantile(finite, part))
    least = NARROWEST * max(abs(first), abs(last))
    if last - first > least:
        return first, last
    return (first - least, last + least) if least else (0.0, 1.0)


def colour_bar(
    drawn: ScalarMappable, axes: Axes, values: ArrayLike, label: str, **place: Any
) -> Colorbar:
    """The scale of colours, with an arrow at each end that some values exceed."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    low, high = drawn.get_clim()
    assert low is not None
    assert high is not None
    beyond = 1e-9 * max(abs(low), abs(high))
    under, over = (finite < low - beyond).any(), (finite > high + beyond).any()
    arrows: Any = "both" if under and over else "min" if under else "max" if over else "neither"
    figure = axes.figure
    assert isinstance(figure, Figure)
    bar = figure.colorbar(drawn, ax=axes, extend=arrows, extendfrac=0.06, **place)
    bar.set_label(label)
    return bar


def with_unit(title: str, unit: str) -> str:
    """A title and its unit, if any."""
    return f"{title} ({unit})" if unit else title


def say(axes: Axes, text: str, y: float = 0.5) -> None:
    """A sentence in a panel, legible on any ground; y: height as a fraction of the panel."""
    axes.text(
        0.5,
        y,
        text,
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize=SMALL,
        path_effects=[outline("white")],
        zorder=10,
    )


def note(
    axes: Axes, text: str, at: tuple[float, float], off: tuple[float, float], **look: Any
) -> None:
    """A text beside a point, legible on any ground; off: points to the right and up."""
    edge: dict[str, Any] = {"path_effects": [outline("white")], "va": "center", "fontsize": SMALL}
    axes.annotate(text, at, off, textcoords="offset points", **(edge | look))


def bars_of(interval: Interval) -> list[list[float]]:
    """Lengths of the bars below and above a value, as `errorbar` takes them; none below zero."""
    value, low, high = interval.value, interval.low, interval.high
    return [[max(value - low, 0)], [max(high - value, 0)]]


def outline(colour: str) -> withStroke:
    """Letters and lines with an edge of this colour stand out from any ground."""
    return withStroke(linewidth=2.0, foreground=colour)


def robust_limit(values: Floats) -> float:
    """Limit of an axis: the largest value, or eight typical values if the largest is far beyond."""
    size = np.abs(values[np.isfinite(values)])
    if not len(size):
        return 1.0
    largest, typical = float(size.max()), float(np.median(size)) / 0.6745
    return 1.08 * (min(largest, 8 * typical) if typical else largest) or 1.0


def number(value: float) -> str:
    """Three digits, without a power of ten up to a million."""
    if not math.isfinite(value):
        return "none"
    if value == 0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}" if abs(value) >= 1e-4 else f"{value:.2g}"


def plain(value: float) -> str:
    """A round number as a reader reads it, such as 0.00001."""
    return (
        f"{value:g}"
        if not 1e-6 <= abs(value) < 1e7
        else np.format_float_positional(float(f"{value:.6g}"), trim="-")
    )


def save_picture(path: Path | None, figure: Figure) -> Figure:
    """Write a picture whole, with plain numbers at all axes: no offsets, no powers of ten.

    path     None: it is not written
    Returns  the figure
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            plain_numbers(axis)
    if path is not None:
        save_figure(path, figure)
    return figure


def plain_numbers(axis: Axis) -> None:
    """Ticks of a logarithmic axis at numbers that a reader reads as they are."""
    if isinstance(axis.get_major_locator(), (ticker.FixedLocator, ticker.NullLocator)):
        return
    if axis.get_scale() == "log":
        low, high = sorted(axis.get_view_interval())
        decades = math.log10(high / low) if low > 0 else 9.0
        if decades < 0.7:
            axis.set_major_locator(ticker.MaxNLocator(5, steps=[1, 2, 5, 10]))
        elif decades < 2.3:
            axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        else:
            axis.set_major_locator(ticker.LogLocator(numticks=5))
    if axis.get_scale() in ("log", "symlog"):
        # Over many decades, zeros would be hard to count.
        low, high = np.abs(axis.get_view_interval())
        wide = axis.get_scale() == "log" and max(low, high) > 1e6 * min(low, high) > 0
        axis.set_major_formatter(lambda value, _: f"{value:g}" if wide else plain(value))
        axis.set_minor_formatter(ticker.NullFormatter())
