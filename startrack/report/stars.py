"""Errors of stars against magnitude and field position; of the attitude against slew rate."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, repeat

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from startrack.budget import Curve, Slew, StarErrors
from startrack.core import Floats, arcsec, deg
from startrack.metrics import rms_interval
from startrack.plots import (
    BLACK,
    BLUE,
    RED,
    draw_intervals,
    legend_below,
    styled,
)
from startrack.report.page import HIGH, WIDE, Picture

BINS = 8
FEWEST = 8  # stars in a bin, at least; chosen by hand


@styled
def draw_stars(seen: StarErrors, half_diagonal: float) -> list[Picture]:
    """Rms centroid error per axis against magnitude and against field position."""
    pictures = []
    for at, label in (
        (seen.magnitude, "magnitude (G)"),
        (seen.radius / half_diagonal, "distance from the middle (half diagonals)"),
    ):
        figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
        axes = figure.subplots()
        _binned(axes, at, seen.error)
        axes.set(xlabel=label, ylabel="centroid error, rms per axis (pixel)", yscale="log")
        legend_below(axes, 1)
        pictures.append(Picture(figure, f"Centroid error of the stars over the {label}"))
    axes.set_xlim(0, 1)
    return pictures


def _binned(axes: Axes, at: Floats, error: Floats) -> None:
    """Rms in bins of equal numbers of stars, bars of 95 %."""
    order = np.argsort(at)
    count = min(BINS, len(order) // FEWEST)
    named = chain(["rms in bins of equal numbers, 95 %"], repeat(None))
    for part in np.array_split(order, count) if count else []:
        rms = rms_interval((error[part] ** 2).mean(axis=1))
        bars = [[max(rms.value - rms.low, 0)], [rms.high - rms.value]]
        axes.errorbar(
            float(at[part].mean()), rms.value, yerr=bars, fmt="o", ms=5, color=BLACK, mfc="white",
            zorder=3, label=next(named),
        )  # fmt: skip
    # Rasterised, because thousands of points would make a large file.
    axes.plot(at, np.sqrt((error**2).mean(axis=1)), ".", ms=3, alpha=0.3, color=BLUE, zorder=0,
              rasterized=True, label=f"each of {len(at)} stars")  # fmt: skip


@styled
def draw_slews(
    slewed: Sequence[Slew], design_rate: float, expected: Curve | None = None
) -> list[Picture]:
    """Error and availability against the rate; `design_rate` in radian / second."""
    rate, pictures = np.array([one.rate for one in slewed]) / deg, []
    solved = any(one.across.value > 0 for one in slewed)
    for name, other, unit, label in (
        ("across", "across", arcsec, "error across, rms per axis (arcsec)"),
        ("fraction", "available", 0.01, "trials with a correct attitude (%)"),
    ):
        figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
        axes = figure.subplots()
        if expected and any(expected.budgets):
            _shade(axes, expected)
            axes.plot(expected.rate / deg, getattr(expected, other) / unit, "--", color=RED,
                      label="analytic budget")  # fmt: skip
        intervals = [getattr(slew, name) for slew in slewed]
        draw_intervals(axes, rate, intervals, unit, fmt="o-", ms=4, color=BLUE,
                       label="trials, 95 %")  # fmt: skip
        axes.axvline(design_rate / deg, color=BLACK, lw=1, ls=":", label="rate of the design")
        axes.set(xlabel="slew rate (deg / s)", ylabel=label)
        axes.set_xscale("symlog", linthresh=max(rate[1], 1e-9))
        axes.set_xlim(-0.2 * rate[1], 1.3 * max(rate[-1], design_rate / deg))
        if name == "fraction":
            axes.set_ylim(-3, 103)
        elif solved:
            axes.set_yscale("log")
        legend_below(axes, 1)
        pictures.append(Picture(figure, f"{label} over the slew rate"))
    return pictures


def _shade(axes: Axes, expected: Curve) -> None:
    """Rates at which the formula leaves out more than at rest."""
    first = expected.first_left_out
    if first is not None:
        axes.axvspan(expected.rate[first] / deg, 1.3 * expected.rate[-1] / deg, color="0.9",
                     zorder=0, label="rates with effects that the budget leaves out")  # fmt: skip
