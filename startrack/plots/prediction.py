"""Picture of a prediction: intervals of each figure, and the causes of the accuracy's width."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from startrack.budget import PUBLISHED
from startrack.core import arcsec
from startrack.plots import style
from startrack.prediction import ACCURACY, AXES, OTHERS, Prediction

MOST = 6  # causes that are drawn


@style.styled
def draw_prediction(path: Path | None, prediction: Prediction, title: str) -> Figure:
    """Intervals of 68 and 95 % of each figure, and fractions of the width of the accuracy.

    path    file to write; None: none is written
    Raises  OSError if the file cannot be written.
    """
    count = len(prediction.unknowns)
    figure = style.picture(
        6.0, f"{title}: {count} value{'s' * (count > 1)} not known; bars hold 68 and 95 %"
    )
    top, below = figure.subplots(2, 1, height_ratios=(3, 2))
    _intervals(top, prediction)
    _widths(below, prediction)
    return style.save_picture(path, figure)


def _intervals(axes: Axes, prediction: Prediction) -> None:
    names = list(PUBLISHED)
    for figure in prediction.figures:
        about = figure.axis == "about"
        y = len(names) - 1 - names.index(figure.figure) - (0.14 if about else -0.14)
        colour = style.RED if about else style.BLUE
        label = figure.axis if figure.figure == names[0] else None
        for low, high, width in (
            (figure.low_95, figure.high_95, 1.2),
            (figure.low_68, figure.high_68, 5.0),
        ):
            thick = width > 2
            ends = [low / arcsec, high / arcsec]
            axes.plot(ends, [y, y], color=colour, lw=width, label=label if thick else None)
        axes.plot(figure.median / arcsec, y, "|", color="white", ms=9, mew=2)
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), reversed(names))
    axes.set_xlabel("error of 1 sigma, rms per axis (arcsec)")
    style.plain_numbers(axes.xaxis)
    axes.set_ylim(-1.2, len(names) - 0.4)
    axes.legend(loc="lower left", ncols=2)


def _widths(axes: Axes, prediction: Prediction) -> None:
    parts = {axis: dict(prediction.figure(ACCURACY, axis).causes) for axis in AXES}
    names = sorted(parts[AXES[0]], key=lambda name: -sum(part[name] for part in parts.values()))[
        :MOST
    ]
    for shift, (axis, part), colour in zip(
        (0.18, -0.18), parts.items(), (style.BLUE, style.RED), strict=True
    ):
        y = [len(names) - 1 - n + shift for n in range(len(names))]
        axes.barh(y, [100 * part[name] for name in names], 0.34, color=colour, label=axis)
    axes.set_yticks(range(len(names)), [_short(name) for name in reversed(names)])
    axes.set_xlabel("width of the accuracy by each cause alone (%)")
    axes.legend(loc="lower right")


def _short(name: str) -> str:
    if name == OTHERS:  # in three lines, beside a narrow picture
        return name.replace(", ", ",\n")
    return ".".join(name.split(".")[-2:])
