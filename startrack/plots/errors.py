"""Picture of the errors of many trials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.core import Floats, arcsec
from startrack.metrics import Interval, summarise
from startrack.plots.style import (
    BLUE,
    RED,
    legend_below,
    number,
    panel_title,
    picture,
    robust_limit,
    save_picture,
    say,
    styled,
)

BINS = 41


@styled
def draw_errors(path: Path | None, outcomes: NDArray[np.void], title: str) -> Figure:
    """The errors of many trials: across the boresight as points, about it as a histogram.

    Axes hold eight times the typical error. Larger ones stand at the edge, and are counted.
    """
    correct = outcomes[outcomes["solved"] & ~outcomes["false"]]
    summary = summarise(outcomes)
    available = summary.availability
    figure = picture(
        4.4,
        f"{title}: {summary.trials} trials, availability {100 * available.value:.1f} % "
        f"[{100 * available.low:.1f}, {100 * available.high:.1f}]; shown: the {len(correct)} "
        "solved and not false",
    )
    across, about = figure.subplots(1, 2)
    x, y, z = (np.asarray(correct[f"error_{axis}"], float) / arcsec for axis in "xyz")
    _across(across, x, y, summary.across)
    _about(about, z, summary.about)
    return save_picture(path, figure)


def _across(axes: Axes, x: Floats, y: Floats, rms: Interval) -> None:
    panel_title(axes, "across the boresight", 36)
    axes.set(xlabel="error about x (arcsec)", ylabel="error about y (arcsec)", aspect="equal")
    if not len(x):
        say(axes, "no attitude")
        return
    limit = robust_limit(np.concatenate([x, y]))
    size = np.hypot(x, y)
    inside = np.maximum(np.abs(x), np.abs(y)) <= limit
    axes.plot(x[inside], y[inside], ".", ms=3, alpha=0.5, color=BLUE, label="trial")
    if not inside.all():
        far = np.stack([x[~inside], y[~inside]])
        # On the edge, in their direction.
        axes.plot(
            *(far * limit / np.abs(far).max(axis=0)), "X", ms=6, color=RED, clip_on=False, zorder=5,
            label=f"{(~inside).sum()} beyond the axes, to {number(float(size.max()))} arcsec",
        )  # fmt: skip
    turn = np.linspace(0, 2 * np.pi, 200)
    radius = rms.value / arcsec
    axes.plot(radius * np.cos(turn), radius * np.sin(turn), color="k", lw=1.2,
              label=f"rms per axis {_interval_text(rms)}")  # fmt: skip
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit))
    legend_below(axes, 1)


def _about(axes: Axes, z: Floats, rms: Interval) -> None:
    panel_title(axes, "about the boresight", 36)
    axes.set(xlabel="error about z (arcsec)", ylabel="number of trials")
    if not len(z):
        say(axes, "no attitude")
        return
    limit = robust_limit(z)
    inside = np.abs(z) <= limit
    axes.hist(
        z[inside], BINS, range=(-limit, limit), color=BLUE, label=f"rms {_interval_text(rms)}"
    )
    if not inside.all():
        for side in (-1, 1):
            many = int((side * z > limit).sum())
            if many:
                axes.annotate(
                    f"{many} beyond", (side * limit, 0), (0, 4), textcoords="offset points",
                    rotation=90, color=RED, fontsize=8.5, va="bottom",
                    ha="right" if side > 0 else "left",
                )  # fmt: skip
        largest = number(float(np.abs(z).max()))
        axes.plot([], [], "X", color=RED,
                  label=f"{(~inside).sum()} beyond the axis, to {largest} arcsec")  # fmt: skip
    axes.set_xlim(-limit, limit)
    legend_below(axes, 1)


def _interval_text(interval: Interval) -> str:
    value, low, high = (number(x / arcsec) for x in (interval.value, interval.low, interval.high))
    return f"{value} [{low}, {high}] arcsec"
