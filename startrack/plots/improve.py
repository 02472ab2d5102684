"""A picture of the search of a problem: forecasts, trials, and fresh trials of start and best."""

from pathlib import Path

import numpy as np

from startrack.optimise import Improved
from startrack.plots import style
from startrack.plots.optimise import draw_forecasts
from startrack.problem import Words


@style.styled
def draw_improvement(path: Path, found: Improved, words: Words) -> None:
    """The objective of each design that was forecast or tried, and at last start and best."""
    factor = found.factor
    figure = style.picture(
        8.4,
        f"start over best on fresh trials: {factor.value:.3g} "
        f"[{factor.low:.3g}, {factor.high:.3g}] (95 %)",
    )
    axes = figure.subplots()
    draw_forecasts(axes, found.landscape)
    before = len(found.landscape.expected)
    tried = np.array([design.error for design in found.evaluations])
    feasible = np.array([design.feasible for design in found.evaluations], bool)
    number = before + 1 + np.arange(len(tried))
    for chosen, marker, colour, label in (
        (feasible, "o", style.GREEN, "meets"),
        (~feasible, "X", style.RED, "misses"),
    ):
        axes.plot(
            number[chosen],
            tried[chosen],
            marker,
            ms=4.5,
            color=colour,
            label=f"by trials, {label} the requirements ({chosen.sum()})",
        )
    end = before + len(tried)
    for place, judged, marker, label in (
        (end + 2, found.judged[0], "s", "start, fresh trials"),
        (end + 4, found.judged[1], "D", "best, fresh trials"),
    ):
        interval = judged.value
        axes.errorbar(
            place,
            interval.value,
            [[interval.value - interval.low], [interval.high - interval.value]],
            fmt=marker,
            ms=5,
            capsize=3,
            color=style.BLUE,
            mfc="none" if marker == "s" else style.BLUE,
            label=label,
        )
    axes.set(
        yscale="log", xlabel="design (number)", ylabel=style.with_unit(words.value, words.unit)
    )
    style.legend_below(axes, 2)
    style.save_picture(path, figure)
