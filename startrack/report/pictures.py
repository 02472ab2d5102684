"""Pictures of the page: distributions and maps of errors, single stars, slew rates."""

import math
from collections.abc import Sequence
from itertools import chain, repeat
from textwrap import fill
from typing import Any

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from startrack import plots
from startrack.budget import BudgetCurve, Slew, StarErrors
from startrack.core import Floats, Ints, Rows, arcsec, deg
from startrack.metrics import Interval, rms_interval
from startrack.montecarlo import Regions, quantile_interval
from startrack.report.page import HIGH, WIDE, PagePicture

FRACTIONS = (0.5, 0.68, 0.9545, 0.9973)
POINTS = 300  # points of a curve
FAR = 20.0  # median errors; the axis is logarithmic for larger errors


def sizes(outcomes: Rows) -> tuple[Floats, Floats]:
    """Sizes of errors of solved trials that are not false, radian: angle across the boresight, size
    about it."""
    correct = outcomes[outcomes["solved"] & ~outcomes["false"]]
    return np.hypot(correct["error_x"], correct["error_y"]), np.abs(correct["error_z"])


def quantiles(size: Floats, units: int = 0) -> list[Interval]:
    """Quantiles of the sizes, radian, with distribution-free 95 % intervals.

    units  number of units, which alone are independent; 0: all trials are
    """
    return [quantile_interval(size, fraction, number=units or None) for fraction in FRACTIONS]


def exceedance(outcomes: Rows) -> list[PagePicture]:
    """Fraction of trials that exceed an error, with its interval, and the normal distribution."""
    across, about = sizes(outcomes)
    rms = [float(np.sqrt(np.mean(size**2))) if len(size) else 1.0 for size in (across, about)]
    return [
        _exceedance(
            across,
            scipy.stats.rayleigh(scale=rms[0] / 2**0.5),
            "angle across the boresight, radial (arcsec)",
        ),
        _exceedance(
            about,
            scipy.stats.halfnorm(scale=rms[1]),
            "size of the error about the boresight (arcsec)",
        ),
    ]


@plots.styled
def _exceedance(size: Floats, law: Any, label: str) -> PagePicture:
    (figure, axes), n = _panel(), len(size)
    picture = PagePicture(figure, f"Fraction of trials beyond each {label}")
    axes.set(xlabel=label, ylabel="fraction of trials beyond")
    if n == 0:
        plots.say(axes, "no attitude")
        return picture
    ordered = np.sort(size)
    rank = np.unique(np.round(np.geomspace(1, n, POINTS)).astype(int))  # from the largest down
    beyond, at = (rank - 0.5) / n, ordered[n - rank] / arcsec
    # The fraction beyond the k-th largest of n is a beta variable.
    low, high = scipy.stats.beta.ppf([[0.025], [0.975]], rank, n - rank + 1)
    axes.fill_between(
        at, low, high, step="mid", color=plots.BLUE, alpha=0.2, lw=0, label="95 % interval"
    )
    axes.plot(at, beyond, color=plots.BLUE, lw=1.3, label=f"{n} trials")
    grid = np.concatenate(
        [np.linspace(0, ordered[-1], POINTS), np.geomspace(ordered[0] / 10, ordered[-1], POINTS)]
    )
    grid.sort()
    axes.plot(
        grid / arcsec,
        law.sf(grid),
        "--",
        color=plots.RED,
        lw=1.2,
        label="normal distribution of this rms",
    )
    axes.set_yscale("log")
    axes.set_ylim(0.3 / n, 1.2)
    # Large outliers need a logarithmic axis, or they would compress the curve.
    if ordered[-1] > FAR * np.median(ordered):
        axes.set_xscale("log")
        axes.set_xlim(left=float(np.median(ordered)) / arcsec / FAR)
    else:
        axes.set_xlim(0, None)
    plots.legend_below(axes, 1)
    return picture


# Least mean number of trials per region, or the sky has fewer regions; least number of trials of a
# region, or it stays blank. Chosen by hand: the rms of 12 trials is known to 15 %.
IN_A_REGION, FEWEST = 12, 5
CUTS = ((6, 12), (4, 8), (3, 6), (2, 4))  # bands and sectors
LETTERS = 50  # letters of a title's line
FINE = 12  # pieces along each border of a region


@plots.styled
def sky_map(boresight: Floats, outcomes: Rows) -> list[PagePicture]:
    """The error of each trial at its boresight, and the rms over regions of equal area.

    The number of trials determines the number of regions; there are none if trials are too few for
    eight.

    boresight  (n, 3) unit vectors of the outcomes, ICRS axes
    """
    solved = outcomes["solved"] & ~outcomes["false"]
    square = (outcomes["error_x"] ** 2 + outcomes["error_y"] ** 2) / 2
    error = np.sqrt(square) / arcsec
    scale = _scale(error[solved])
    figure, axes = _sky()
    x, y = _plane(boresight)
    points = axes.scatter(
        x[solved],
        y[solved],
        c=error[solved],
        s=9,
        norm=scale,
        cmap="viridis",
        rasterized=len(outcomes) > 3000,
    )
    text = f"each of {len(outcomes)} trials"
    if not solved.all():
        axes.scatter(
            x[~solved], y[~solved], marker="X", s=36, color=plots.RED, ec=plots.BLACK, lw=0.5
        )
        text += f"; red crosses: {(~solved).sum()} with no or a false attitude"
    axes.set_title(fill(text, LETTERS))
    _bar(points, axes, error[solved])
    pictures = [PagePicture(figure, "Map of the sky with the error of each trial")]
    cut = next((parts for parts in CUTS if solved.sum() >= IN_A_REGION * math.prod(parts)), None)
    if cut:
        regions = Regions(*cut)
        figure, axes = _sky()
        rms = _cell_rms(regions, regions.of(boresight[solved]), square[solved])
        drawn = _regions(axes, regions, rms / arcsec, scale)
        axes.set_title(f"rms per axis in {len(regions)} regions of equal area")
        _bar(drawn, axes, rms / arcsec)
        pictures.append(PagePicture(figure, "Map of the sky with the rms error of its regions"))
    return pictures


def _sky() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDE, 0.9 * HIGH), layout="constrained")
    axes = figure.subplots(subplot_kw={"projection": "mollweide"})
    hours = np.arange(-150, 151, 60)
    axes.set_xticks(np.radians(hours), [f"{int(-h % 360) // 15} h" for h in hours])
    axes.set_yticks(np.radians([-60, -30, 0, 30, 60]))
    axes.set_axisbelow(False)  # numbers and lines above the map
    for text in axes.get_xticklabels():
        text.set(path_effects=[plots.outline("white")])
    return figure, axes


def _panel() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
    return figure, figure.subplots()


def _bar(drawn: ScalarMappable, axes: Axes, values: Floats) -> None:
    """The scale of colours; arrows mark values beyond it."""
    label = "error across the boresight (arcsec)"
    plots.colour_bar(drawn, axes, values, label, orientation="horizontal", shrink=0.8, pad=0.04)


def _scale(error: Floats) -> LogNorm:
    low, high = np.quantile(error, [0.02, 0.98]) if len(error) else (0.1, 1.0)
    return LogNorm(max(low, 1e-6), max(high, 2e-6, 1.01 * low))


def _plane(direction: Floats) -> tuple[Floats, Floats]:
    """Longitude and latitude on the map: right ascension grows to the left, 12 h at the edge."""
    x, y, z = direction.T
    return -np.arctan2(y, x), np.arcsin(np.clip(z, -1, 1))


def _cell_rms(regions: Regions, cell: Ints, square: Floats) -> Floats:
    count = np.bincount(cell, minlength=len(regions))
    total = np.bincount(cell, square, minlength=len(regions))
    mean = np.divide(total, count, out=np.full(len(regions), np.nan), where=count >= FEWEST)
    return np.asarray(np.sqrt(mean))


def _regions(axes: Axes, regions: Regions, value: Floats, scale: LogNorm) -> QuadMesh:
    # From 12 h over 0 h to 12 h, edge to edge; finely divided, because borders are curved.
    cells = np.roll(value.reshape(regions.bands, regions.sectors), regions.sectors // 2, axis=1)
    fine = cells.repeat(FINE, axis=0).repeat(FINE, axis=1)
    ra, dec = Regions(regions.bands * FINE, regions.sectors * FINE).corners()
    return axes.pcolormesh(math.pi - ra, dec, fine, norm=scale, cmap="viridis", rasterized=True)


BINS = 8
FEWEST = 8  # least number of stars in a bin; chosen by hand


@plots.styled
def draw_stars(seen: StarErrors, half_diagonal: float) -> list[PagePicture]:
    """Rms centroid error per axis against magnitude and against field position."""
    pictures = []
    for at, label in (
        (seen.magnitude, "magnitude (G)"),
        (seen.radius / half_diagonal, "distance from the middle (half diagonals)"),
    ):
        figure, axes = _panel()
        _binned(axes, at, seen.error)
        axes.set(xlabel=label, ylabel="centroid error, rms per axis (pixel)", yscale="log")
        plots.legend_below(axes, 1)
        pictures.append(PagePicture(figure, f"Centroid error of the stars over the {label}"))
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
            float(at[part].mean()),
            rms.value,
            yerr=bars,
            fmt="o",
            ms=5,
            color=plots.BLACK,
            mfc="white",
            zorder=3,
            label=next(named),
        )
    # Rasterised: thousands of points would make a large file.
    axes.plot(
        at,
        np.sqrt((error**2).mean(axis=1)),
        ".",
        ms=3,
        alpha=0.3,
        color=plots.BLUE,
        zorder=0,
        rasterized=True,
        label=f"each of {len(at)} stars",
    )


@plots.styled
def draw_slews(
    slewed: Sequence[Slew], design_rate: float, expected: BudgetCurve
) -> list[PagePicture]:
    """Error and availability against the rate; `design_rate` in radian / second."""
    rate, pictures = np.array([slew.rate for slew in slewed]) / deg, []
    solved = any(slew.across.value > 0 for slew in slewed)
    for name, other, unit, label in (
        ("across", "across", arcsec, "error across, rms per axis (arcsec)"),
        ("fraction", "available", 0.01, "trials with a correct attitude (%)"),
    ):
        figure, axes = _panel()
        if any(expected.budgets):
            first = expected.first_left_out
            if first is not None:  # at rest the formula omits fewer effects
                axes.axvspan(
                    expected.rate[first] / deg,
                    1.3 * expected.rate[-1] / deg,
                    color="0.9",
                    zorder=0,
                    label="rates with effects that the budget leaves out",
                )
            axes.plot(
                expected.rate / deg,
                getattr(expected, other) / unit,
                "--",
                color=plots.RED,
                label="analytic budget",
            )
        intervals = [getattr(slew, name) for slew in slewed]
        plots.draw_intervals(
            axes, rate, intervals, unit, fmt="o-", ms=4, color=plots.BLUE, label="trials, 95 %"
        )
        axes.axvline(design_rate / deg, color=plots.BLACK, lw=1, ls=":", label="rate of the design")
        axes.set(xlabel="slew rate (deg / s)", ylabel=label)
        axes.set_xscale("symlog", linthresh=max(rate[1], 1e-9))
        axes.set_xlim(-0.2 * rate[1], 1.3 * max(rate[-1], design_rate / deg))
        if name == "fraction":
            axes.set_ylim(-3, 103)
        elif solved:
            axes.set_yscale("log")
        plots.legend_below(axes, 1)
        pictures.append(PagePicture(figure, f"{label} over the slew rate"))
    return pictures
